"""Motor currents as the drives would show them: holding the tool up, and friction."""

from __future__ import annotations

from math import degrees, tanh
from typing import final

from sims.kernel import Kernel
from sims.scene.arm import MovingArm
from sims.scene.motions import Joints
from sims.world.statics import GRAVITY_M_S2
from sims.world.world import World

NM_PER_A = 60.0
"""Joint torque per ampere through the reducer: no published figure of this robot, the order of its class."""
COULOMB_A = 0.3
VISCOUS_A_S_DEG = 0.004
_REFRESH_NS = 100_000_000
_STEP_DEG = 0.01


@final
class MotorCurrents:
    """Amperes of A1…An. The links' own weight is not in it: the robot file has no masses of them."""

    def __init__(self, kernel: Kernel, robot: MovingArm, world: World, mass_kg: float) -> None:
        self._kernel = kernel
        self._robot = robot
        self._world = world
        self._weight_n = mass_kg * GRAVITY_M_S2
        self._holding: Joints = ()
        self._stale_at = -1

    def now(self) -> list[float]:
        """At this moment; the weight's share is worked out anew every 100 ms, it changes slowly."""
        state = self._robot.state()
        if self._kernel.now >= self._stale_at:
            self._holding = tuple(torque / NM_PER_A for torque in self._torques(state.joints))
            self._stale_at = self._kernel.now + _REFRESH_NS
        return [
            hold + COULOMB_A * tanh(10.0 * v) + VISCOUS_A_S_DEG * v
            for hold, v in zip(self._holding, state.velocity, strict=True)
        ]

    def _torques(self, joints: Joints) -> list[float]:
        """N·m: how the tool's height changes with each joint, times its weight."""
        height = self._world.true_tcp(joints)[2]
        torques = []
        for i, joint in enumerate(joints):
            raised = self._world.true_tcp((*joints[:i], joint + _STEP_DEG, *joints[i + 1 :]))[2]
            torques.append(self._weight_n * (raised - height) * 1e-3 / _STEP_DEG * degrees(1.0))
        return torques
