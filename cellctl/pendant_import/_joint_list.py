"""Joint lists of any kind as postures: their kind, number of joints, degrees or radians, limits."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import replace

from cellctl.files import InputError, Problem
from cellctl.formats.dataset import BEYOND_LIMITS_DEG, BEYOND_TRAVEL_MM
from cellctl.kinematics import MM_PER_M
from cellctl.pendant_import._fanuc import between_the_arms
from cellctl.pendant_import._points import TABLE, Point, PointList, RawList, Value, read_values
from cellctl.pendant_import._programs import program_postures
from cellctl.pendant_import._typed_table import Cells, cells_of, headed, lacking, optional_columns, raw_points, unheaded
from cellctl.pendant_import.choices import AngleUnit, Choices
from cellctl.robot_file import RobotFile

_JOINT = re.compile(r"[AJq]([1-9]\d?)")
_EXTERNAL = re.compile(r"E\d")
_NO_RADIANS = 4.0 * math.pi
"""Two turns either way: readings in radians are within it, and hardly any posture in degrees is completely."""
_CURE_ANGLES = "--angles deg or --angles rad"
_NO_ROBOT = (6, 7)
_MOST_JOINTS = 20


def joint_texts(text: str, file: str, choices: Choices, robot: RobotFile | None, measured: Sequence[str]) -> RawList:
    """The postures of a joint list, as text. measured: columns that the same table must also hold, none for two files.

    Raises InputError where the file as a whole cannot be read.
    """
    found = program_postures(text, file, robot.n if robot else None)
    if found is None:
        return _from_table(cells_of(text, file), choices, robot, measured)
    if measured:
        cure = "give the table of positions too, as the second file"
        raise InputError(Problem(file, 0, 0, "holds joints only", cure))
    return found


def _from_table(table: Cells, choices: Choices, robot: RobotFile | None, measured: Sequence[str]) -> RawList:
    joints = [f"{letter}{number}" for letter in "AJq" for number in range(1, _MOST_JOINTS + 1)]
    head = headed(table, choices.columns, joints)
    if head is None:
        sizes = (robot.n,) if robot else _NO_ROBOT
        layouts = [[*(f"J{number}" for number in range(1, size + 1)), *measured] for size in sizes]
        cure = "name the columns: --columns A1=…,X=…; or, without headings, say how many joints: --robot ROBOT"
        head = unheaded(table, layouts, cure)
    own = [name for name in head.places if _JOINT.fullmatch(name) or _EXTERNAL.fullmatch(name)]
    missing = [name for name in measured if name not in head.places]
    if missing:
        problem = lacking(table.file, head, missing, choices.columns)
        raise InputError(replace(problem, what=f"{problem.what}, and no table of positions is given"))
    extra = [name for name in choices.columns if name in head.places and name != "name"]
    stated = optional_columns(head) if measured else []
    return raw_points(table, head, list(dict.fromkeys([*own, *measured, *extra, *stated])))


def joint_points(raw: RawList, choices: Choices, robot: RobotFile | None, measured: Sequence[str] = ()) -> PointList:
    """Postures with `A1…An` in degrees or `q1…qn` in radians, as in the file; of a prismatic joint mm or m, which the
    file has to hold. A point that is not a posture has a fault.

    Raises InputError where the number of joints, the decimal sign or the unit of the angles is not certain.
    """
    names = _joints(raw, robot)
    read = read_values(raw, [*names, *measured], choices.decimal)
    turning = [name for number, name in enumerate(names, 1) if robot is None or number not in robot.prismatic]
    unit, how = _unit(raw, read, turning or names, choices)
    letter = "A" if unit == "deg" else "q"
    renamed = {name: f"{letter}{place}" for place, name in enumerate(names, 1)}
    still, moves = _external_axes(read)
    turned, third = between_the_arms(raw, [_renamed(point, renamed, still) for point in read.points], choices, robot)
    points = tuple(_checked(point, unit, len(names), robot) for point in turned)
    return replace(read, points=points, decided=(*read.decided, how, moves, third))


def _joints(raw: RawList, robot: RobotFile | None) -> list[str]:
    """The joints' columns in their order, without gaps."""
    found = {column for point in raw.points for column in point.texts if _JOINT.fullmatch(column)}
    letters = sorted({name[0] for name in found})
    numbers = sorted(int(name[1:]) for name in found)
    n = robot.n if robot else len(numbers)
    if len(letters) == 1 and numbers == list(range(1, n + 1)):
        return [f"{letters[0]}{number}" for number in numbers]
    line, columns = raw.heading_line, ", ".join(sorted(found, key=lambda name: (name[0], int(name[1:]))))
    if not found:
        reasons = [Problem(raw.file, point.line, 0, point.fault) for point in raw.points if point.fault][:10]
        raise InputError([Problem(raw.file, line, 0, "holds no joint readings"), *reasons])
    whose = f"the robot file has {n} joints" if robot else "joints are counted from 1 without gaps"
    what = f"holds the joints {columns}; {whose}"
    raise InputError(Problem(raw.file, line, 0, what, "give all of them, or name the columns: --columns A1=…,A2=…"))


def _unit(raw: RawList, read: PointList, names: Sequence[str], choices: Choices) -> tuple[AngleUnit, str]:
    """Degrees or radians, and the reason."""
    stated: set[AngleUnit] = {"rad" if raw.units[name] == "rad" else "deg" for name in names if raw.units.get(name)}
    usable = [point for point in read.points if not point.fault]
    beyond = [point for point in usable if _reach(point, names) > _NO_RADIANS]
    if len(stated) > 1 or (choices.angles and stated - {choices.angles}):
        what = f"its joints are stated to be in {' and '.join(sorted(stated | {choices.angles or 'deg'}))}"
        raise InputError(Problem(raw.file, raw.heading_line, 0, what, f"correct the headings, or {_CURE_ANGLES}"))
    unit = choices.angles or next(iter(stated), None)
    if unit:
        how = "--angles" if choices.angles else "the file"
        small = unit == "deg" and not any(_reach(point, names) > 2.0 * math.pi for point in usable)
        doubt = "; no reading is beyond 6.28: are they not radians?" if small and usable else ""
        return unit, f"joints in {_word(unit)}, as {how} says{doubt}" if raw.source is TABLE or doubt else ""
    largest = max((_reach(point, names) for point in usable), default=0.0)
    mostly = len(beyond) * 2 >= len(usable) and bool(usable)
    if names[0][0] in "AJ" and mostly:
        return "deg", f"joints in degrees, up to {largest:g}"
    if names[0][0] == "q" and usable and not beyond:
        return "rad", f"joints in radians, as '{names[0]}' means in a data set, up to {largest:g}"
    what = f"degrees or radians? The headings do not name a unit, and the readings go up to {largest:g}"
    raise InputError(Problem(raw.file, raw.heading_line, 0, what, _CURE_ANGLES))


def _reach(point: Point, names: Sequence[str]) -> float:
    return max(abs(float(point.values[name])) for name in names)


def _word(unit: AngleUnit) -> str:
    return "degrees" if unit == "deg" else "radians"


def _external_axes(read: PointList) -> tuple[set[str], str]:
    """External axes that do not move, which are ignored, and a message about those that do."""
    found: dict[str, set[Value]] = {}
    for point in read.points:
        for name in point.values.keys() if not point.fault else ():
            if _EXTERNAL.fullmatch(name):
                found.setdefault(name, set()).add(point.values[name])
    moving = sorted(name for name, values in found.items() if len(values) > 1)
    stated = (
        f"{', '.join(moving)} not the same in all postures: kept, but a fit takes the base as fixed" if moving else ""
    )
    return found.keys() - set(moving), stated


def _renamed(point: Point, names: dict[str, str], dropped: set[str]) -> Point:
    kept = {name: value for name, value in point.values.items() if name not in dropped}
    return replace(point, values={names.get(name, name): value for name, value in kept.items()})


def _checked(point: Point, unit: AngleUnit, n: int, robot: RobotFile | None) -> Point:
    """The point, with a fault where a reading cannot be one of this robot."""
    if point.fault:
        return point
    for number in range(1, n + 1):
        name = f"{'A' if unit == 'deg' else 'q'}{number}"
        value = float(point.values[name])
        limits = robot.joints[number - 1] if robot else None
        if limits and limits.prismatic:
            mm = MM_PER_M * value if unit == "rad" else value
            if not limits.min - BEYOND_TRAVEL_MM <= mm <= limits.max + BEYOND_TRAVEL_MM:
                what = f"{name} is {mm:.6g} mm, outside {limits.min:g}…{limits.max:g} mm of the robot file"
                return replace(point, fault=what)
            continue
        if unit == "rad" and abs(value) > _NO_RADIANS:
            return replace(point, fault=f"{name} is {value:g}: more than two turns, no angle in radians")
        degrees = math.degrees(value) if unit == "rad" else value
        if limits and not limits.min - BEYOND_LIMITS_DEG <= degrees <= limits.max + BEYOND_LIMITS_DEG:
            what = f"{name} is {degrees:.6g}°, outside {limits.min:g}…{limits.max:g}° of the robot file"
            return replace(point, fault=what)
    return point
