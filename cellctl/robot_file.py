"""Robot files: links or axes, joint map and limits, base, tool, repeatability; and checks for impossible content."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, Protocol, Self, TypeAlias, final

import numpy as np
from pydantic import BaseModel, ConfigDict, Discriminator, Field, SerializerFunctionWrapHandler, Tag, model_serializer

from cellctl.files import Document, InputError, Problem, load_yaml
from cellctl.files.kinds import ROBOT
from cellctl.files.validated import validated
from cellctl.kinematics import (
    Floats,
    JointAxis,
    JointMap,
    JointUnit,
    Link,
    SerialChain,
    pose_from_xyz_abc,
    rotation_from_abc,
)

_FORMS = {"mdh-hayati": ("links",), "dh-craig": ("links",), "poe": ("screws", "home")}
"""The sections with a robot's geometry, by convention."""

LEAST_TRAVEL_MM = 10.0
"""A prismatic joint that reaches no further was written in metres: rails, lifts and quills travel further."""

PARALLEL_DEG = 1.0
"""Axes at a smaller angle to each other count as parallel."""

Number = Annotated[float, Field(allow_inf_nan=False)]
Length = Annotated[float, Field(allow_inf_nan=False, ge=-20_000, le=20_000)]
Angle = Annotated[float, Field(allow_inf_nan=False, ge=-360, le=360)]
Positive = Annotated[float, Field(allow_inf_nan=False, gt=0)]
Triple = Annotated[list[Length], Field(min_length=3, max_length=3)]
Angles = Annotated[list[Angle], Field(min_length=3, max_length=3)]
Direction = Annotated[list[Number], Field(min_length=3, max_length=3)]

Text = Annotated[str, Field(min_length=1)]

_STRICT = ConfigDict(extra="forbid", strict=True, frozen=True)

UPRIGHT = (0.0, 0.0, -1.0)
"""Direction of weight for a robot on the floor."""

STANDING: dict[str, tuple[float, float, float]] = {
    "floor": (0.0, 0.0, 0.0),
    "wall": (0.0, 90.0, 0.0),
    "ceiling": (0.0, 180.0, 0.0),
}
"""A, B, C, deg, of each name of a mounting; on a wall the base's X points down."""


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
class ScrewRow(BaseModel):
    """One joint's axis at model zero, in the robot's base frame: direction (of any length but 0), a point on it, mm."""

    model_config = _STRICT
    axis: Direction
    point: Triple


@final
class JointRow(BaseModel):
    """One joint: model coordinate = sign · reading + offset; limits in controller readings. deg, deg/s; mm, mm/s of a
    prismatic joint.
    """

    model_config = _STRICT
    type: Annotated[Literal["revolute", "prismatic"], Field(exclude_if=lambda kind: kind == "revolute")] = "revolute"
    sign: Literal[1, -1] = 1
    offset: Annotated[float, Field(allow_inf_nan=False, ge=-100_000, le=100_000)] = 0.0
    min: Annotated[float, Field(allow_inf_nan=False, ge=-100_000, le=100_000)]
    max: Annotated[float, Field(allow_inf_nan=False, ge=-100_000, le=100_000)]
    max_speed: Positive

    @property
    def prismatic(self) -> bool:
        """Whether it slides along its axis."""
        return self.type == "prismatic"

    @property
    def unit(self) -> JointUnit:
        """The unit of its reading, as people read it."""
        return "mm" if self.prismatic else "°"


@final
class Frame(BaseModel):
    """Pose of a frame: xyz in mm, KUKA angles A, B, C in degrees."""

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
class Tilt(BaseModel):
    """Orientation in a level world: KUKA angles A, B, C in degrees; A, the heading, does not change the tilt."""

    model_config = _STRICT
    tilt: Angles

    @classmethod
    def under(cls, down: Sequence[float]) -> Self:
        """The tilt with heading 0 in which the world's −z is `down`, a unit vector."""
        x, y, z = down
        return cls(tilt=[0.0, math.degrees(math.atan2(x, math.hypot(y, z))), math.degrees(math.atan2(-y, -z))])


Mounting: TypeAlias = Annotated[
    Annotated[Literal["floor", "wall", "ceiling"], Tag("word")] | Annotated[Tilt, Tag("angles")],
    Discriminator(lambda value: "angles" if isinstance(value, dict | Tilt) else "word"),
]


@final
class StatedTolerances(BaseModel):
    """Tolerances of this make about its table, 1 σ, mm and degrees: the prior before a measurement.

    link_mm, angle_deg: lengths and angles of the links (or of the axes); joint_zero_deg: the joints' zeros; tool_mm,
    tool_deg: the taught tool. None where the file does not state it.
    """

    model_config = _STRICT
    link_mm: Positive | None = None
    angle_deg: Positive | None = None
    joint_zero_deg: Positive | None = None
    tool_mm: Positive | None = None
    tool_deg: Positive | None = None


@final
class SecondSource(BaseModel):
    """An independent second source. agreement_mm: largest distance of the two flanges at the same readings, mm."""

    model_config = _STRICT
    against: Text
    agreement_mm: Annotated[float, Field(allow_inf_nan=False, ge=0)]


Checked: TypeAlias = Annotated[
    Annotated[Literal["single source"], Tag("word")] | Annotated[SecondSource, Tag("second")],
    Discriminator(lambda value: "second" if isinstance(value, dict | SecondSource) else "word"),
]


@final
class Source(BaseModel):
    """Origin of a robot file's numbers.

    numbers: document, or package and file, of the link table; licence: of that source; payload: rated, kg. limits: of
    limits and speeds, repeatability: of the repeatability, where these are from elsewhere. controller_j3: `horizontal`
    where the controller shows J3 against the horizontal, and the file's J3 is the angle between the arms.
    """

    model_config = _STRICT
    maker: Text
    payload: Positive | None = None
    numbers: Text
    licence: Text
    checked: Checked
    limits: Text | None = None
    repeatability: Text | None = None
    controller_j3: Literal["horizontal"] | None = None
    remarks: Text | None = None


@final
class MakersCalibration(BaseModel):
    """The maker's own calibration of one arm, from which the file's geometry is, in place of the data sheet.

    file: that it was read from. hash: by which a controller knows it, where the file states it.
    """

    model_config = _STRICT
    file: Text
    hash: Text | None = None

    @model_serializer(mode="wrap")
    def _as_written(self, serialize: SerializerFunctionWrapHandler) -> dict[str, Any]:
        return {name: value for name, value in serialize(self).items() if value is not None}


@final
class RobotFile(BaseModel):
    """A robot as in its file: by `links`, or (`poe`) by `screws` and the flange's pose `home` at model zero.

    repeatability: 1 σ of the distance to the mean, 3-D, mm. mounting: orientation of the frame in which `base` is
    given. calibration: of this arm by its maker; None: the geometry is the data sheet's. source: origin of the numbers;
    it is no property of the robot, and models do not contain it.
    """

    model_config = _STRICT
    name: Text
    convention: Literal["mdh-hayati", "dh-craig", "poe"]
    links: Annotated[list[LinkRow], Field(max_length=20)] = []
    screws: Annotated[list[ScrewRow], Field(max_length=20)] = []
    home: Frame | None = None
    joints: Annotated[list[JointRow], Field(min_length=1, max_length=20)]
    mounting: Mounting = "floor"
    base: Frame = Frame()
    tool: Tool = Tool()
    repeatability: Annotated[float, Field(allow_inf_nan=False, gt=0, le=100)]
    tolerances: StatedTolerances | None = None
    calibration: MakersCalibration | None = None
    source: Annotated[Source | None, Field(exclude=True)] = None

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read a robot file. Raises InputError with every error, each with its line and column."""
        return cls.from_document(load_yaml(path, ROBOT))

    @classmethod
    def from_document(cls, document: Document) -> Self:
        """A robot from a loaded document. Raises InputError with every error."""
        problems = form_problems(document)
        try:
            robot = validated(document, cls)
        except InputError as error:
            raise InputError([*problems, *error.problems]) from error
        problems = problems or contradictions(document, robot)
        if problems:
            raise InputError(problems)
        return robot

    @property
    def geometry_source(self) -> str:
        """Whose numbers the nominal geometry is: the data sheet's, or the maker's calibration of this arm."""
        return "data sheet" if self.calibration is None else f"maker's calibration ({self.calibration.file})"

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.links or self.screws)

    def chain(self) -> SerialChain:
        """The nominal chain: links or axes, base and tool as in the file."""
        base, tool = _pose(self.base), _pose(self.tool)
        if self.convention == "poe":
            axes = [
                JointAxis.through(row.point, row.axis, prismatic=joint.prismatic)
                for row, joint in zip(self.screws, self.joints, strict=True)
            ]
            return SerialChain.from_axes(axes, _pose(self.home or Frame()), base, tool)
        links = [_link(row, joint.prismatic) for row, joint in zip(self.links, self.joints, strict=True)]
        return SerialChain.from_links(self.convention, links, base, tool)

    @property
    def prismatic(self) -> tuple[int, ...]:
        """Numbers, from 1, of its prismatic joints."""
        return prismatic_numbers(self.joints)

    def refuse_prismatic(self, file: str, what: str) -> None:
        """`refuse_prismatic` for this robot."""
        refuse_prismatic(self.name, self.prismatic, file, what)

    def down(self) -> tuple[float, float, float]:
        """Direction of weight in the robot's own base frame (behind `base`): a unit vector."""
        tilt = self.mounting.tilt if isinstance(self.mounting, Tilt) else STANDING[self.mounting]
        turn = rotation_from_abc(tilt) @ rotation_from_abc(self.base.abc)
        x, y, z = (np.round(-turn[2], 15) + 0.0).tolist()  # the cosine of 90° is 0
        return x, y, z

    def joint_map(self) -> JointMap:
        """Controller readings (deg, mm) to model coordinates (rad, m) and back."""
        return JointMap.from_lists(
            [joint.sign for joint in self.joints],
            [joint.offset for joint in self.joints],
            [joint.prismatic for joint in self.joints],
        )

    def limits(self) -> Floats:
        """Joint limits (n, 2) in controller readings, deg or mm: lower, upper."""
        return np.array([[joint.min, joint.max] for joint in self.joints])

    def max_speeds(self) -> Floats:
        """Greatest joint speeds (n,), deg/s or mm/s."""
        return np.array([joint.max_speed for joint in self.joints])

    @model_serializer(mode="wrap")
    def _as_written(self, serialize: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Without the sections that the file does not have, so that a robot's hash covers only the file's content."""
        absent = {name for name in ("links", "screws", "home", "tolerances", "calibration") if not getattr(self, name)}
        absent |= {"mounting"} if self.mounting == "floor" else set()
        return {name: value for name, value in serialize(self).items() if name not in absent}


class _Kinded(Protocol):
    @property
    def prismatic(self) -> bool: ...


def prismatic_numbers(joints: Iterable[_Kinded]) -> tuple[int, ...]:
    """Numbers, from 1, of the prismatic ones of a robot's joints."""
    return tuple(number for number, joint in enumerate(joints, 1) if joint.prismatic)


def refuse_prismatic(robot: str, prismatic: Sequence[int], file: str, what: str) -> None:
    """Raise InputError where a robot has prismatic joints (from 1), and `what` cannot have any.

    robot: its name; file: named in the error; what: as "a compensation table".
    """
    if not prismatic:
        return
    one = len(prismatic) == 1
    joints = f"joint{'' if one else 's'} {', '.join(map(str, prismatic))}"
    cure = "give a robot file of the arm alone, with `base` at the place of its carriage"
    words = f"{joints} of {robot} {'is' if one else 'are'} prismatic: {what} is for revolute joints only"
    raise InputError(Problem(file, 0, 0, words, cure))


def _link(row: LinkRow, prismatic: bool) -> Link:
    beta = None if row.beta is None else math.radians(row.beta)
    return Link(math.radians(row.theta), row.d, row.a, math.radians(row.alpha), beta, prismatic)


def _pose(frame: Frame | Tool) -> Floats:
    return pose_from_xyz_abc(frame.xyz, frame.abc)


def form_problems(document: Document) -> list[Problem]:
    """Missing sections of the convention, and sections of another convention."""
    data = document.data if isinstance(document.data, dict) else {}
    convention = data.get("convention")
    if convention not in _FORMS:
        return []
    needed, all_forms = _FORMS[convention], dict.fromkeys(name for names in _FORMS.values() for name in names)
    problems = []
    for name in all_forms:
        if name in needed and not data.get(name):
            cure = f"convention {convention} is given by {' and '.join(needed)}"
            problems.append(document.problem((name,), f"'{name}' is missing", cure, key=True))
        elif name not in needed and name in data:
            cure = f"convention {convention} is given by {' and '.join(needed)}: remove one of the two"
            problems.append(document.problem((name,), f"'{name}' does not go with {convention}", cure, key=True))
    return problems


def contradictions(document: Document, robot: RobotFile) -> list[Problem]:
    """Errors in well-formed content."""
    return [
        *_counts(document, robot),
        *_limits(document, robot),
        *_offsets(document, robot),
        *_travels(document, robot),
        *_table(document, robot),
        *_axes(document, robot),
    ]


def _counts(document: Document, robot: RobotFile) -> list[Problem]:
    if len(robot.joints) == robot.n:
        return []
    rows = "screws" if robot.convention == "poe" else "links"
    what = f"{len(robot.joints)} joints for {robot.n} {rows}"
    return [document.problem(("joints",), what, f"one row in joints for each row in {rows}", key=True)]


def _limits(document: Document, robot: RobotFile) -> list[Problem]:
    return [
        document.problem(("joints", index, "min"), f"joint {index + 1}: min {row.min:g} is not below max {row.max:g}")
        for index, row in enumerate(robot.joints)
        if row.min >= row.max
    ]


def _offsets(document: Document, robot: RobotFile) -> list[Problem]:
    return [
        document.problem(
            ("joints", index, "offset"), f"joint {index + 1}: offset {row.offset:g} is not from -360 to 360"
        )
        for index, row in enumerate(robot.joints)
        if not row.prismatic and abs(row.offset) > 360.0
    ]


def _travels(document: Document, robot: RobotFile) -> list[Problem]:
    """Prismatic joints whose limits are as small as metres are."""
    return [
        document.problem(
            ("joints", index, "max"),
            f"joint {index + 1}: {row.min:g}…{row.max:g} looks like metres",
            "write travel limits in mm, max_speed in mm/s",
        )
        for index, row in enumerate(robot.joints)
        if row.prismatic and row.min < row.max and max(-row.min, row.max) < LEAST_TRAVEL_MM
    ]


def _table(document: Document, robot: RobotFile) -> list[Problem]:
    problems = []
    for index, row in enumerate(robot.links):
        problems += _radians(document, row, index)
        if row.beta is None and parallel_to_neighbour(robot.convention, row.alpha, index, robot.n):
            what = f"link {index + 1}: its two axes are parallel: its d cannot be distinguished from its neighbour's"
            problems.append(document.problem(("links", index), what, "add 'beta: 0' to this link"))
    return problems


def _radians(document: Document, row: LinkRow, index: int) -> list[Problem]:
    return [
        document.problem(
            ("links", index, name),
            f"link {index + 1}: {name} {getattr(row, name):g} looks like radians",
            "write degrees",
        )
        for name in ("theta", "alpha", "beta")
        if looks_like_radians(getattr(row, name))
    ]


def _axes(document: Document, robot: RobotFile) -> list[Problem]:
    return [
        document.problem(
            ("screws", index, "axis"), f"screw {index + 1}: its axis has no direction", "three numbers, not all 0"
        )
        for index, row in enumerate(robot.screws)
        if not any(row.axis)
    ]


def looks_like_radians(angle: float | None) -> bool:
    """Whether an angle in degrees is a multiple of a quarter turn in radians: 1.571, −3.1416, 4.71239."""
    quarters = round(abs(angle or 0.0) / (math.pi / 2))
    if not 1 <= quarters <= 4:
        return False
    exact = quarters * math.pi / 2
    return any(abs(abs(angle or 0.0) - round(exact, digits)) < 1e-12 for digits in range(3, 17))


def parallel_to_neighbour(convention: str, alpha_deg: float, index: int, n: int) -> bool:
    """Whether row `index` (from 0) of `n` has its alpha between two joints, and leaves their axes parallel."""
    between = index < n - 1 if convention == "mdh-hayati" else index > 0
    return between and abs(math.sin(math.radians(alpha_deg))) < math.sin(math.radians(PARALLEL_DEG))
