"""The true motor currents of the arm, and its brakes: every device that shows currents reads them here."""

from __future__ import annotations

from typing import final

from sims.kernel import Kernel
from sims.scene.arm import MovingArm
from sims.scene.motions import Joints
from sims.world.world import World

BRAKES_AFTER_S = 10.0
"""Standstill after which the brakes close [unconfirmed: of the order of a controller's default]."""

_FAST_DEG_S = 0.1
_NEAR_DEG = 0.05


@final
class MotorCurrents:
    """Amperes of A1…An, true means without any device's noise. `brakes_after_ns`: see `BRAKES_AFTER_S`."""

    def __init__(self, kernel: Kernel, arm: MovingArm, world: World) -> None:
        self.brakes_after_ns = round(BRAKES_AFTER_S * 1e9)
        self._kernel = kernel
        self._arm = arm
        self._world = world
        self._holding: Joints = ()
        self._held_at: Joints = ()

    def brakes_closed(self, time_ns: int | None = None) -> bool:
        """Whether the brakes hold the arm: it has stood for a while and nothing corrects it."""
        since = self._arm.standing_since()
        now = self._kernel.now if time_ns is None else time_ns
        return since is not None and now - since >= self.brakes_after_ns

    def at(self, time_ns: int | None = None) -> tuple[float, ...]:
        """Now, or at another moment of the present motion: weight and friction; 0 with closed brakes."""
        now = self._kernel.now if time_ns is None else time_ns
        joints, velocity = self._arm.joints_at(now)
        if self.brakes_closed(now):
            return (0.0,) * len(joints)
        friction = self._world.motors.friction(self._arm.sliding(now), velocity)
        return tuple(a + b for a, b in zip(self._hold(joints, velocity), friction, strict=True))

    def _hold(self, joints: Joints, velocity: Joints) -> Joints:
        """The weight's share; in fast motion it is worked out anew every 0.05°."""
        near = _NEAR_DEG if max(map(abs, velocity)) > _FAST_DEG_S else 0.0
        if not self._held_at or any(abs(a - b) > near for a, b in zip(joints, self._held_at, strict=True)):
            self._held_at, self._holding = joints, self._world.holding_currents(joints)
        return self._holding
