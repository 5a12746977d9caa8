"""Orientations as other systems write them, as A, B, C: Rz(A) Ry(B) Rx(C), degrees."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

from cellctl.pendant_import.choices import Orientation
from cellctl.pendant_import.points import Point, PointList, Value

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
    from scipy.spatial.transform import Rotation

    from cellctl.kinematics import abc_from_rotation

    turn = Rotation.from_rotvec(radians) if kind == "rotation-vector" else Rotation.from_euler("XYZ", radians)
    return [round(float(angle), _DIGITS) + 0.0 for angle in abc_from_rotation(turn.as_matrix())]
