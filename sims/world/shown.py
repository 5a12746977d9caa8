"""The pose that the controller shows: it knows the nominal model and the taught tool only."""

from __future__ import annotations

from collections.abc import Sequence
from math import asin, atan2, degrees, radians
from typing import final

from sims.robot_file import RobotFile
from sims.world.nominal import Geometry, pose, vector
from sims.world.screws import Arm, Vector

Pose = tuple[float, float, float, float, float, float]
"""X Y Z (mm) and A B C (degrees, KUKA)."""


@final
class Shown:
    """Of one robot file. `arm`: the nominal one; `tcp`: the taught TCP at model zero, mm, base frame."""

    def __init__(self, robot: RobotFile, nominal: Geometry) -> None:
        tool = nominal.flange @ pose(robot.tool.xyz, robot.tool.abc)
        self.arm = Arm(nominal.axes)
        self.tcp = vector(tool[:3, 3])
        self._directions = vector(tool[:3, 0]), vector(tool[:3, 2])
        self._joints = [(float(joint.sign), float(joint.offset)) for joint in robot.joints]

    def pose(self, readings: Sequence[float]) -> Pose:
        """X Y Z A B C at these readings."""
        angles = [
            radians(sign * reading + offset) for (sign, offset), reading in zip(self._joints, readings, strict=True)
        ]
        place, along_x, along_z = self.arm.carry(angles, self.tcp, *self._directions)
        return *place, *angles_abc(along_x, along_z)


def angles_abc(x: Vector, z: Vector) -> Vector:
    """A, B, C in degrees of a frame with these directions."""
    xx, xy, xz = x
    zx, zy, zz = z
    return (
        degrees(atan2(xy, xx)),
        degrees(asin(max(-1.0, min(1.0, -xz)))),
        degrees(atan2(zx * xy - zy * xx, zz)),  # z of y = z × x
    )
