"""A robot in any of its forms: the common content of robot files, URDF, DH tables and models."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Self, final

from cellctl.formats.robot import UPRIGHT, Mounting, RobotFile, StatedTolerances, Tilt

if TYPE_CHECKING:
    from cellctl.kinematics import JointMap, SerialChain


LEVEL = 1e-3
"""A frame tilted by less than this is upright, rad: less than an instrument's base is known to be level."""


@final
@dataclass(frozen=True, slots=True)
class JointSaid:
    """One joint: model angle = sign · reading + offset; limits of the reading. deg, deg/s; None: not stated."""

    sign: int = 1
    offset: float = 0.0
    min: float | None = None
    max: float | None = None
    max_speed: float | None = None
    name: str | None = None


@final
@dataclass(frozen=True, eq=False)
class RobotDescription:
    """A robot: its chain without deviations, its joints, and the other content of its file.

    repeatability: 1 σ, 3-D, mm; None where the form has no place for it. mounting: orientation in the world of the
    frame in which the chain's base is given; z is up in forms that do not state it.
    """

    name: str
    chain: SerialChain
    joints: tuple[JointSaid, ...]
    repeatability: float | None = None
    tool_mass: float = 0.0
    tolerances: StatedTolerances | None = field(default=None)
    mounting: Mounting = "floor"

    @classmethod
    def of(cls, robot: RobotFile, chain: SerialChain | None = None) -> Self:
        """A robot file's robot; `chain`, where given, in place of the nominal one: deviations become its geometry."""
        from cellctl.kinematics import settled

        joints = tuple(JointSaid(row.sign, row.offset, row.min, row.max, row.max_speed) for row in robot.joints)
        form, mounting = settled(chain or robot.chain()), _mounting(robot, chain)
        return cls(robot.name, form, joints, robot.repeatability, robot.tool.mass, robot.tolerances, mounting)

    def joint_map(self) -> JointMap:
        """Controller readings (deg) to model angles (rad) and back."""
        from cellctl.kinematics import JointMap

        return JointMap.from_lists([joint.sign for joint in self.joints], [joint.offset for joint in self.joints])


def _mounting(robot: RobotFile, chain: SerialChain | None) -> Mounting:
    """Mounting of the measuring frame of `chain`, if that is not the frame in which the file's base is given."""
    if chain is None or (chain.base_now[:3, :3] == robot.chain().base[:3, :3]).all():
        return robot.mounting
    down = (chain.base_now[:3, :3] @ robot.down()).tolist()
    return "floor" if math.dist(down, UPRIGHT) < LEVEL else Tilt.under(down)
