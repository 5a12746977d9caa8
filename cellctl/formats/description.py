"""A robot in any of its forms, and robot files as text: the output of `cellctl convert`, in the manual's form."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Self, final

from cellctl.files import InputError, Problem, parse_yaml
from cellctl.kinematics import (
    AxisTable,
    Convention,
    Floats,
    JointMap,
    Link,
    LinkTable,
    SerialChain,
    abc_from_rotation,
    settled,
    to_craig,
    to_mdh,
    to_poe,
)
from cellctl.robot_file import UPRIGHT, MakersCalibration, Mounting, RobotFile, StatedTolerances, Tilt

LEVEL = 1e-3
"""A frame tilted by less than this is upright, rad: less than an instrument's base is known to be level."""


@final
@dataclass(frozen=True, slots=True)
class JointSaid:
    """One joint: model coordinate = sign · reading + offset; limits of the reading. deg, deg/s; of a prismatic joint
    mm, mm/s. None: not stated.
    """

    sign: int = 1
    offset: float = 0.0
    min: float | None = None
    max: float | None = None
    max_speed: float | None = None
    name: str | None = None
    prismatic: bool = False


@final
@dataclass(frozen=True, eq=False)
class RobotDescription:
    """A robot: its chain without deviations, its joints, and the other content of its file.

    repeatability: 1 σ, 3-D, mm; None where the form has no place for it. mounting: orientation in the world of the
    frame in which the chain's base is given; z is up in forms that do not state it. calibration: its maker's, if the
    chain is from it.
    """

    name: str
    chain: SerialChain
    joints: tuple[JointSaid, ...]
    repeatability: float | None = None
    tool_mass: float = 0.0
    tolerances: StatedTolerances | None = field(default=None)
    mounting: Mounting = "floor"
    calibration: MakersCalibration | None = None

    @classmethod
    def of(cls, robot: RobotFile, chain: SerialChain | None = None) -> Self:
        """A robot file's robot; `chain`, where given, in place of the nominal one: deviations become its geometry."""
        joints = tuple(
            JointSaid(row.sign, row.offset, row.min, row.max, row.max_speed, prismatic=row.prismatic)
            for row in robot.joints
        )
        form, mounting = settled(chain or robot.chain()), _mounting(robot, chain)
        calibration = robot.calibration if chain is None else None
        mass, tolerances = robot.tool.mass, robot.tolerances
        return cls(robot.name, form, joints, robot.repeatability, mass, tolerances, mounting, calibration)

    def joint_map(self) -> JointMap:
        """Controller readings (deg, mm) to model coordinates (rad, m) and back."""
        return JointMap.from_lists(
            [joint.sign for joint in self.joints],
            [joint.offset for joint in self.joints],
            [joint.prismatic for joint in self.joints],
        )


def _mounting(robot: RobotFile, chain: SerialChain | None) -> Mounting:
    """Mounting of the measuring frame of `chain`, if that is not the frame in which the file's base is given."""
    if chain is None or (chain.base_now[:3, :3] == robot.chain().base[:3, :3]).all():
        return robot.mounting
    down = (chain.base_now[:3, :3] @ robot.down()).tolist()
    return "floor" if math.dist(down, UPRIGHT) < LEVEL else Tilt.under(down)


DECIMALS_MM = 10
"""Lengths are written to 1e-10 mm, angles to 1e-12°: a TCP at 3 m is exact to 1e-9 mm."""
DECIMALS_DEG = 12


def robot_text(robot: RobotDescription, convention: Convention, source: str) -> str:
    """The robot file of `robot` in `convention`, checked as if it were read; `source` names its origin in errors.

    Raises InputError where the source lacks what a robot file needs, or the robot does not fit into one.
    """
    problems = _missing(robot, source)
    if problems:
        raise InputError(problems)
    text = "".join(f"{line}\n" for line in _lines(robot, convention))
    RobotFile.from_document(parse_yaml(text, f"{source} as {convention}"))
    return text


def in_poe(robot: RobotFile) -> RobotFile:
    """The same robot with its joints' axes in place of a link table. Raises InputError where a limit is missing."""
    if robot.convention == "poe":
        return robot
    text = robot_text(RobotDescription.of(robot), "poe", robot.name)
    return RobotFile.from_document(parse_yaml(text, f"{robot.name} as poe"))


def plain_number(value: float, decimals: int) -> str:
    """A number as a person would write it: no trailing `.0`, no `-0`, no exponent, which YAML 1.1 reads as text."""
    rounded = round(value, decimals) + 0.0
    text = f"{rounded:.{decimals}f}" if "e" in repr(rounded) else repr(rounded)
    return text.rstrip("0").rstrip(".") if "." in text else text


def mm(value: float) -> str:
    """A length in mm."""
    return plain_number(value, DECIMALS_MM)


def degrees(radians: float) -> str:
    """An angle in degrees, from radians."""
    return plain_number(math.degrees(radians), DECIMALS_DEG)


def frame_words(matrix: Floats) -> str:
    """A pose (4, 4) as `xyz: […], abc: […]`."""
    xyz = ", ".join(mm(value) for value in matrix[:3, 3].tolist())
    abc = ", ".join(plain_number(value, DECIMALS_DEG) for value in abc_from_rotation(matrix[:3, :3]).tolist())
    return f"xyz: [{xyz}], abc: [{abc}]"


def _missing(robot: RobotDescription, source: str) -> list[Problem]:
    problems = []
    for index, joint in enumerate(robot.joints, 1):
        lacking = [name for name in ("min", "max", "max_speed") if getattr(joint, name) is None]
        if lacking:
            called = f" ({joint.name})" if joint.name else ""
            what = f"says no {', '.join(lacking)} of joint {index}{called}, which a robot file needs"
            problems.append(
                Problem(source, 0, 0, what, "add it to the source: limits and speed of the joint's reading")
            )
    if robot.repeatability is None:
        what = "does not say the robot's repeatability, which a robot file needs"
        problems.append(Problem(source, 0, 0, what, "give it: --repeatability MM (1 σ, 3-D)"))
    return problems


def _lines(robot: RobotDescription, convention: Convention) -> list[str]:
    chain = _in(robot.chain, convention)
    mass = f", mass: {plain_number(robot.tool_mass, 9)}" if robot.tool_mass else ""
    return [
        f"name: {json.dumps(_printable(robot.name), ensure_ascii=False)}",
        f"convention: {convention}",
        *_geometry_lines(chain.table),
        "joints:",
        *(f"  - {{{_joint_words(joint)}}}" for joint in robot.joints),
        *_mounting_lines(robot),
        f"base: {{{frame_words(chain.base)}}}",
        f"tool: {{{frame_words(chain.tool)}{mass}}}",
        f"repeatability: {plain_number(robot.repeatability or 0.0, 9)}",
        *_tolerance_lines(robot.tolerances),
        *_calibration_lines(robot.calibration),
    ]


def _printable(name: str) -> str:
    """YAML reads some characters as ends of lines, and others not at all."""
    return "".join(letter if letter.isprintable() else " " for letter in name)


def _in(chain: SerialChain, convention: Convention) -> SerialChain:
    return {"poe": to_poe, "mdh-hayati": to_mdh, "dh-craig": to_craig}[convention](chain)


def _geometry_lines(table: LinkTable | AxisTable) -> list[str]:
    if isinstance(table, LinkTable):
        return ["links:", *(f"  - {{{_link_words(row)}}}" for row in table.links)]
    screws = [
        f"  - {{axis: [{_vector(axis.direction, 15)}], point: [{_vector(axis.point, DECIMALS_MM)}]}}"
        for axis in table.axes
    ]
    return ["screws:", *screws, f"home: {{{frame_words(table.home)}}}"]


def _link_words(row: Link) -> str:
    words = {"theta": degrees(row.theta), "d": mm(row.d), "a": mm(row.a), "alpha": degrees(row.alpha)}
    if row.beta is not None:
        words["beta"] = degrees(row.beta)
        if words["d"] == "0":  # beta replaces it
            del words["d"]
    return ", ".join(f"{name}: {value}" for name, value in words.items())


def _vector(values: Floats, decimals: int) -> str:
    return ", ".join(plain_number(value, decimals) for value in values.tolist())


def _joint_words(joint: JointSaid) -> str:
    values: Sequence[tuple[str, float | None]] = [
        ("sign", joint.sign),
        ("offset", joint.offset),
        ("min", joint.min),
        ("max", joint.max),
        ("max_speed", joint.max_speed),
    ]
    kind = "type: prismatic, " if joint.prismatic else ""
    return kind + ", ".join(f"{name}: {plain_number(float(value or 0.0), DECIMALS_DEG)}" for name, value in values)


def _mounting_lines(robot: RobotDescription) -> list[str]:
    if not isinstance(robot.mounting, Tilt):
        return [f"mounting: {robot.mounting}"] if robot.mounting != "floor" else []
    return [f"mounting: {{tilt: [{', '.join(plain_number(angle, DECIMALS_DEG) for angle in robot.mounting.tilt)}]}}"]


def _tolerance_lines(tolerances: StatedTolerances | None) -> list[str]:
    if tolerances is None:
        return []
    said = [f"{name}: {plain_number(value, 9)}" for name, value in tolerances.model_dump().items() if value is not None]
    return [f"tolerances: {{{', '.join(said)}}}"]


def _calibration_lines(calibration: MakersCalibration | None) -> list[str]:
    if calibration is None:
        return []
    words = [f"{name}: {json.dumps(_printable(value))}" for name, value in calibration.model_dump().items()]
    return [f"calibration: {{{', '.join(words)}}}"]
