"""A table of positions as a person typed it: X, Y, Z in mm, and orientation where its convention is certain."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

from cellctl.files import InputError, Problem
from cellctl.kinematics import abc_from_rotation
from cellctl.pendant_import._instrument import (
    SIGMA_COLUMNS,
    UNCERTAINTIES,
    described,
    of_group,
    with_sigmas,
    with_times,
)
from cellctl.pendant_import._points import Point, PointList, RawList, Value, in_mm, read_values
from cellctl.pendant_import._typed_table import cells_of, headed, lacking, optional_columns, raw_points, unheaded
from cellctl.pendant_import.choices import Choices, Orientation

ABC = ("A", "B", "C")
QUATERNION = ("QW", "QX", "QY", "QZ")
RXYZ = ("RX", "RY", "RZ")
COLUMNS: Mapping[Orientation, tuple[str, ...]] = {
    "abc": ABC,
    "quaternion": QUATERNION,
    "fixed-xyz": RXYZ,
    "euler-xyz": RXYZ,
    "rotation-vector": RXYZ,
}
"""The columns of each notation."""
_NO_UNIT = 0.01
_DIGITS = 9


def oriented(points: PointList, kind: Orientation, units: Mapping[str, str]) -> PointList:
    """The points with the orientation as a data set has it: A, B, C, deg, or a unit quaternion.

    units: of the angles where the file states them; else degrees, for a rotation vector radians. A point whose
    quaternion is none has a fault.
    """
    return replace(points, points=tuple(_oriented(point, kind, units) for point in points.points))


def _oriented(point: Point, kind: Orientation, units: Mapping[str, str]) -> Point:
    if point.fault:
        return point
    columns = COLUMNS[kind]
    numbers = [float(point.values[name]) for name in columns]
    if kind == "quaternion":
        length = math.sqrt(sum(number**2 for number in numbers))
        off = abs(length - 1.0) > _NO_UNIT
        return replace(point, fault="QW, QX, QY, QZ is no unit quaternion") if off else point
    usual = "rad" if kind == "rotation-vector" else "deg"
    if kind == "abc" and not any(units.get(name) == "rad" for name in columns):
        return point
    in_rad = [(units.get(name) or usual) == "rad" for name in columns]
    radians = [number if rad else math.radians(number) for number, rad in zip(numbers, in_rad, strict=True)]
    angles: dict[str, Value] = dict(zip(ABC, _abc(kind, radians), strict=True))
    return replace(point, values={name: value for name, value in point.values.items() if name not in RXYZ} | angles)


def _abc(kind: Orientation, radians: list[float]) -> list[float]:
    """A, B, C, deg, of the three numbers of a notation, rad.

    fixed-xyz: turns about the fixed X, then Y, then Z (Rz(RZ) Ry(RY) Rx(RX); the same as Euler angles Z, Y, X).
    euler-xyz: about X, the new Y, the new Z (Rx(RX) Ry(RY) Rz(RZ)). rotation-vector: axis times angle.
    """
    if kind in ("abc", "fixed-xyz"):
        return [round(math.degrees(angle), _DIGITS) for angle in (radians if kind == "abc" else reversed(radians))]
    from scipy.spatial.transform import Rotation  # at first use: it takes 0.2 s

    turn = Rotation.from_rotvec(radians) if kind == "rotation-vector" else Rotation.from_euler("XYZ", radians)
    return [round(float(angle), _DIGITS) + 0.0 for angle in abc_from_rotation(turn.as_matrix())]


XYZ = ("X", "Y", "Z")
_SURELY_MM = 500.0
"""A larger spread is in millimetres: in centimetres it would be 5 m, in inches 12.7 m."""
_UNIT_CURE = "--unit mm, m, cm, um or inch"
_FEWEST_FOR_SPREAD = 4


def measured_columns(choices: Choices) -> tuple[str, ...]:
    """The columns that a measurement has."""
    return (*XYZ, *(COLUMNS[choices.orientation] if choices.orientation else ()))


def position_texts(text: str, file: str, choices: Choices) -> RawList:
    """The rows of a table of positions, as text. Raises InputError where its columns are not certain."""
    table = cells_of(text, file)
    head = headed(table, choices.columns, XYZ)
    wanted = measured_columns(choices)
    if head is None:
        head = unheaded(table, [wanted], "give headings: name;X;Y;Z, or name the columns: --columns X=…,Y=…,Z=…")
    missing = [name for name in wanted if name not in head.places]
    if missing:
        raise InputError(lacking(file, head, missing, choices.columns))
    angles = dict.fromkeys(name for names in COLUMNS.values() for name in names)
    turned = [name for name in angles if name in head.places and name not in wanted]
    decided = (f"{', '.join(turned)} not taken (--orientation says what they mean)",) if turned else ()
    extra = [name for name in choices.columns if name in head.places and name != "name"]
    raw = raw_points(table, head, list(dict.fromkeys([*wanted, *extra, *optional_columns(head)])))
    raw = described(with_times(of_group(raw, choices)), table, head)
    return replace(raw, decided=(*raw.decided, *decided))


def position_points(raw: RawList, choices: Choices) -> PointList:
    """Points with X, Y, Z in mm. Raises InputError where the decimal sign or the unit is not certain."""
    return measured(raw, read_values(raw, measured_columns(choices), choices.decimal), choices)


def measured(raw: RawList, read: PointList, choices: Choices) -> PointList:
    """The list with its X, Y, Z and their σ in mm, and with faults where an orientation cannot be one."""
    units, how = _units(raw, read, choices)
    stated = {name: raw.units.get(name) or units[name[1:]] for name in (*SIGMA_COLUMNS, *UNCERTAINTIES)}
    points = tuple(_scaled(point, {**stated, **units}) for point in read.points)
    found = with_sigmas(replace(read, points=points, decided=(*read.decided, how)), choices)
    return oriented(found, choices.orientation, raw.units) if choices.orientation else found


def _units(raw: RawList, read: PointList, choices: Choices) -> tuple[Mapping[str, str], str]:
    stated = {axis: raw.units[axis] for axis in XYZ if raw.units.get(axis)}
    line = raw.heading_line
    if choices.unit:
        other = sorted(set(stated.values()) - {choices.unit})
        if other:
            what = f"{raw.stated_by} {', '.join(other)}, --unit says {choices.unit}"
            raise InputError(Problem(raw.file, line, 0, what, "correct one of them"))
        return dict.fromkeys(XYZ, choices.unit), f"positions in {choices.unit}, as --unit says"
    if len(stated) == len(XYZ):
        return stated, f"positions in {', '.join(dict.fromkeys(stated.values()))}, as {raw.stated_by}"
    if stated:
        without = ", ".join(axis for axis in XYZ if axis not in stated)
        raise InputError(
            Problem(raw.file, line, 0, f"the headings say no unit for {without}", f"add it, or {_UNIT_CURE}")
        )
    spread = _spread([point for point in read.points if not point.fault])
    if spread is None:
        what = f"mm, metres or inches? No unit is named; fewer than {_FEWEST_FOR_SPREAD} positions do not show it"
        raise InputError(Problem(raw.file, line, 0, what, _UNIT_CURE))
    if spread > _SURELY_MM:
        return dict.fromkeys(XYZ, "mm"), f"positions in mm: no unit is named, and they spread over {spread:.4g}"
    what = f"mm, metres or inches? No unit is named, and the positions spread over {spread:.4g} only"
    raise InputError(Problem(raw.file, line, 0, what, _UNIT_CURE))


def _spread(points: Sequence[Point]) -> float | None:
    """The largest extent along an axis, a tenth of the points (at least one) left out at each end (slips).

    None where there are too few points.
    """
    if len(points) < _FEWEST_FOR_SPREAD:
        return None
    cut = max(1, len(points) // 10)
    axes = [sorted(float(point.values[axis]) for point in points) for axis in XYZ]
    return max(values[-1 - cut] - values[cut] for values in axes)


def _scaled(point: Point, units: Mapping[str, str]) -> Point:
    if point.fault:
        return point
    values = {name: in_mm(value, units[name]) if name in units else value for name, value in point.values.items()}
    return replace(point, values=values)
