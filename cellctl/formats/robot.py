"""Robot files: link table, joint map and limits, base, tool, repeatability. The numbers of a person; no mathematics."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, Self, final

from pydantic import BaseModel, ConfigDict, Field

from cellctl.files import Document, InputError, Problem, load_yaml
from cellctl.files.validated import validated

if TYPE_CHECKING:
    from cellctl.kinematics import Floats, JointMap, SerialChain

Number = Annotated[float, Field(allow_inf_nan=False)]
Length = Annotated[float, Field(allow_inf_nan=False, ge=-20_000, le=20_000)]
Angle = Annotated[float, Field(allow_inf_nan=False, ge=-360, le=360)]
Positive = Annotated[float, Field(allow_inf_nan=False, gt=0)]
Triple = Annotated[list[Length], Field(min_length=3, max_length=3)]
Angles = Annotated[list[Angle], Field(min_length=3, max_length=3)]

_STRICT = ConfigDict(extra="forbid", strict=True, frozen=True)


@final
class LinkRow(BaseModel):
    """One row of the link table, mm and degrees. `beta` (even 0) in place of `d` where axes are near parallel."""

    model_config = _STRICT
    theta: Angle = 0.0
    d: Length = 0.0
    a: Length = 0.0
    alpha: Angle = 0.0
    beta: Angle | None = None


@final
class JointRow(BaseModel):
    """One joint: model angle = sign · reading + offset; limits in controller readings. deg, deg/s."""

    model_config = _STRICT
    sign: Literal[1, -1] = 1
    offset: Angle = 0.0
    min: Annotated[float, Field(allow_inf_nan=False, ge=-100_000, le=100_000)]
    max: Annotated[float, Field(allow_inf_nan=False, ge=-100_000, le=100_000)]
    max_speed: Positive


@final
class Frame(BaseModel):
    """Where a frame is: xyz in mm, KUKA angles A, B, C in degrees."""

    model_config = _STRICT
    xyz: Triple = [0.0, 0.0, 0.0]
    abc: Angles = [0.0, 0.0, 0.0]


@final
class Tool(BaseModel):
    """The tool centre point in the flange frame, mm and degrees; mass in kg, 0 where it is not known."""

    model_config = _STRICT
    xyz: Triple = [0.0, 0.0, 0.0]
    abc: Angles = [0.0, 0.0, 0.0]
    mass: Annotated[float, Field(allow_inf_nan=False, ge=0, le=5000)] = 0.0


@final
class RobotFile(BaseModel):
    """A robot as its file says it is. repeatability: 1 σ of the distance to the mean, 3-D, mm."""

    model_config = _STRICT
    name: Annotated[str, Field(min_length=1)]
    convention: Literal["mdh-hayati", "dh-craig"]
    links: Annotated[list[LinkRow], Field(min_length=1, max_length=20)]
    joints: Annotated[list[JointRow], Field(min_length=1, max_length=20)]
    base: Frame = Frame()
    tool: Tool = Tool()
    repeatability: Annotated[float, Field(allow_inf_nan=False, gt=0, le=100)]

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read a robot file. Raises InputError with every mistake, each with its line and column."""
        return cls.from_document(load_yaml(path))

    @classmethod
    def from_document(cls, document: Document) -> Self:
        """A robot from a loaded document. Raises InputError with every mistake."""
        refused = _unready_convention(document)
        if refused:
            raise InputError(refused)
        robot = validated(document, cls)
        problems = [*_counts(document, robot), *_limits(document, robot), *_table(document, robot)]
        if problems:
            raise InputError(problems)
        return robot

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.links)

    def chain(self) -> SerialChain:
        """The nominal chain: table, base and tool as the file says."""
        from cellctl.kinematics import Link, SerialChain, pose_from_xyz_abc

        links = [
            Link(
                math.radians(row.theta),
                row.d,
                row.a,
                math.radians(row.alpha),
                None if row.beta is None else math.radians(row.beta),
            )
            for row in self.links
        ]
        base = pose_from_xyz_abc(self.base.xyz, self.base.abc)
        return SerialChain.from_links(self.convention, links, base, pose_from_xyz_abc(self.tool.xyz, self.tool.abc))

    def joint_map(self) -> JointMap:
        """Controller readings (deg) to model angles (rad) and back."""
        from cellctl.kinematics import JointMap

        return JointMap.from_lists([joint.sign for joint in self.joints], [joint.offset for joint in self.joints])

    def limits(self) -> Floats:
        """Joint limits (n, 2) in controller readings, deg: lower, upper."""
        import numpy as np

        return np.array([[joint.min, joint.max] for joint in self.joints])

    def max_speeds(self) -> Floats:
        """Greatest joint speeds (n,), deg/s."""
        import numpy as np

        return np.array([joint.max_speed for joint in self.joints])


def _unready_convention(document: Document) -> list[Problem]:
    if isinstance(document.data, dict) and document.data.get("convention") == "poe":
        cure = "write the link table as mdh-hayati or dh-craig"
        return [document.problem(("convention",), "robots given by screws (poe) cannot be read yet", cure)]
    return []


def _counts(document: Document, robot: RobotFile) -> list[Problem]:
    if len(robot.joints) == robot.n:
        return []
    what = f"{len(robot.joints)} joints for {robot.n} links"
    return [document.problem(("joints",), what, "one row in joints for each row in links", key=True)]


def _limits(document: Document, robot: RobotFile) -> list[Problem]:
    return [
        document.problem(("joints", index, "min"), f"joint {index + 1}: min {row.min:g} is not below max {row.max:g}")
        for index, row in enumerate(robot.joints)
        if row.min >= row.max
    ]


def _table(document: Document, robot: RobotFile) -> list[Problem]:
    problems = []
    for index, row in enumerate(robot.links):
        for name in ("theta", "alpha", "beta"):
            if _looks_like_radians(getattr(row, name)):
                what = f"link {index + 1}: {name} {getattr(row, name):g} looks like radians"
                problems.append(document.problem(("links", index, name), what, "write degrees"))
        if row.beta is None and _parallel_to_neighbour(robot, index):
            what = f"link {index + 1}: its two axes are parallel, so that its d cannot be told from its neighbour's"
            problems.append(document.problem(("links", index), what, "add 'beta: 0' to this link"))
    return problems


def _looks_like_radians(angle: float | None) -> bool:
    quarters = abs(angle or 0.0) / (math.pi / 2)
    return 0.9 < quarters < 4.1 and abs(quarters - round(quarters)) < 1e-3


def _parallel_to_neighbour(robot: RobotFile, index: int) -> bool:
    """Whether this link's alpha lies between two joints and leaves their axes within 1° of parallel."""
    between = index < robot.n - 1 if robot.convention == "mdh-hayati" else index > 0
    return between and abs(math.sin(math.radians(robot.links[index].alpha))) < math.sin(math.radians(1.0))
