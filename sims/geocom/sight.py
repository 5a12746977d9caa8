"""What the instrument sees of the scene, and the faults that change it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import hypot, radians
from typing import final

from sims.faults import Faults
from sims.geocom import air, optics
from sims.geocom.optics import Direction, Matrix, Seen
from sims.scene.scene import Scene

COMPENSATOR_RAD = radians(4 / 60)
"""The compensator's range: ± 4′."""

GROSS_TILT_RAD = radians(1.0)
"""The instrument refuses to measure beyond this tilt."""


@final
class Sight:
    """The reflectors in the instrument's frame, levelled where the compensator does it, at the present moment.

    lost: reflectors that are gone (fault `tracker.reflector_lost`).
    """

    def __init__(self, scene: Scene, faults: Faults) -> None:
        self._scene = scene
        self._faults = faults
        self.lost: set[str] = set()

    def targets(self, *, compensated: bool, wanted: Callable[[Seen], bool] = lambda seen: True) -> tuple[Seen, ...]:
        """The wanted reflectors that can be seen now."""
        if self._faults.active("tracker.beam_broken"):
            return ()
        scene, tilt = self._scene, self.tilt if compensated and self.compensator_works else (0.0, 0.0)
        return optics.visible(
            scene.reflectors(),
            self._station(),
            tilt,
            scene.blocked,
            lambda seen: seen.id not in self.lost and wanted(seen),
        )

    def with_second(self, seen: tuple[Seen, ...], axis: Direction) -> tuple[Seen, ...]:
        """And a reflection beside the reflector nearest to the axis, while the fault is active."""
        fault = self._faults.active("tracker.second_target")
        first = optics.nearest(seen, axis, radians(10))
        if fault is None or first is None:
            return seen
        x, y, z = first.xyz
        across = fault.settings["beside_mm"] / max(hypot(x, y), 1.0)
        return (*seen, replace(first, id=f"{first.id} second", xyz=(x + y * across, y - x * across, z)))

    @property
    def compensator_works(self) -> bool:
        """Whether the tilt is in the compensator's range."""
        return max(map(abs, self.tilt)) <= COMPENSATOR_RAD

    @property
    def grossly_tilted(self) -> bool:
        """Whether nothing can be measured at all."""
        return hypot(*self.tilt) > GROSS_TILT_RAD

    @property
    def tilt(self) -> tuple[float, float]:
        """By which the standing axis leans, about the instrument's x and y, rad."""
        fault = self._faults.active("tracker.tilt")
        about_x, about_y = optics.tilt_of(self._station(), self._scene.world.up)
        return (about_x + radians(fault.settings["arcmin"] / 60), about_y) if fault else (about_x, about_y)

    def ppm(self) -> float:
        """The atmospheric correction that the true air needs."""
        true = self._scene.environment()
        vapour = air.vapour_of_humidity(true.air_c, true.humidity_percent)
        return air.ppm(true.air_c, true.pressure_hpa, vapour)

    def air_c(self) -> float:
        """Temperature of the air."""
        return self._scene.environment().air_c

    def pose(self) -> str:
        """What the robot has been commanded to, and how often: the key of the noise."""
        arm = self._scene.arm
        return ",".join(f"{joint:.4f}" for joint in arm.commanded) + f" {arm.attempt}"

    def changes(self) -> tuple[bool, bool, int]:
        """Whether the arm moves, the beam is broken, and how many reflectors are lost: the reasons to look again."""
        broken = self._faults.active("tracker.beam_broken") is not None
        return (self._scene.arm.moving, broken, len(self.lost))

    def _station(self) -> Matrix:
        found: list[list[float]] = self._scene.station().tolist()
        return found
