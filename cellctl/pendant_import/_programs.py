"""Robot programs as points: which language a text is, and its points as postures or as targets."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import final

from cellctl.pendant_import._fanuc import fanuc_points, is_fanuc
from cellctl.pendant_import._krl import axis_listing, is_axis_listing, is_krl, is_krl_program, krl_points, krl_targets
from cellctl.pendant_import._points import Raw, RawList, Source, Taught
from cellctl.pendant_import._rapid import is_rapid, rapid_points
from cellctl.pendant_import._script import is_number_lists, script_points
from cellctl.pendant_import.choices import Length, Orientation


@final
@dataclass(frozen=True, slots=True)
class Targets:
    """Cartesian points as text. orientation: how their angles are meant; length: the unit of X, Y, Z.

    postures: columns with the joints of the same points, none where not all have them.
    """

    raw: RawList
    orientation: Orientation
    length: Length = "mm"
    postures: tuple[str, ...] = ()


def program_postures(text: str, file: str, joints: int | None) -> RawList | None:
    """The postures of a program or of a listing of axes; None for a table. joints: how many the robot has."""
    if is_fanuc(text):
        points, decided = fanuc_points(text)
        return _postures(file, "fanuc", points, decided)
    if is_rapid(text):
        return _postures(file, "rapid", rapid_points(text), ["RAPID, degrees, decimal point"])
    if is_krl(text):
        return krl_points(text, file)
    if is_axis_listing(text):
        return axis_listing(text, file)
    if is_number_lists(text):
        points = script_points(text, joints)
        return _postures(file, "lists", points, ["lists of numbers, radians, decimal point"])
    return None


def program_targets(text: str, file: str) -> Targets | None:
    """The Cartesian points of a program; None for a table."""
    if is_fanuc(text):
        points, decided = fanuc_points(text)
        return Targets(_targets(file, "fanuc", points, [*decided, "W, P, R as C, B, A"]), "abc")
    if is_rapid(text):
        words = ["RAPID, mm and quaternions, decimal point"]
        return Targets(_targets(file, "rapid", rapid_points(text), words), "quaternion")
    if is_krl(text) or is_krl_program(text):
        return Targets(_targets(file, "krl", krl_targets(text), ["KRL, mm and degrees, decimal point"]), "abc")
    if is_number_lists(text):
        points = script_points(text, None)
        raw = _targets(file, "lists", points, ["poses p[…], m and rotation vectors in rad, decimal point"])
        return _with_postures(Targets(raw, "rotation-vector", "m"), points)
    return None


def _postures(file: str, source: Source, points: Sequence[Taught], decided: Sequence[str]) -> RawList:
    raw = _without_doubles([point.posture() for point in points])
    axes = sorted({label for point in raw for label in point.texts})
    unit = "rad" if source == "lists" else "deg"
    return RawList(file, source, raw, dict.fromkeys(axes, unit), tuple(decided))


def _targets(file: str, source: Source, points: Sequence[Taught], decided: Sequence[str]) -> RawList:
    raw = _without_doubles([point.target() for point in points])
    return RawList(file, source, raw, {}, tuple(decided))


def _with_postures(targets: Targets, points: Sequence[Taught]) -> Targets:
    """The targets with the joints of the waypoints of the same names, if all have them: `Waypoint_1_p`, `…_q`."""
    joints = {point.name: point.joints for point in points if point.name and point.joints}
    good = [point for point in targets.raw.points if not point.fault]
    columns = {tuple(joints.get(point.name, ())) for point in good}
    if len(columns) != 1 or not (found := columns.pop()):
        return targets
    taught = tuple(replace(point, texts={**point.texts, **joints.get(point.name, {})}) for point in targets.raw.points)
    decided = (*targets.raw.decided, "with the joints of the same waypoints as postures")
    return replace(targets, raw=replace(targets.raw, points=taught, decided=decided), postures=found)


def _without_doubles(points: Sequence[Raw]) -> tuple[Raw, ...]:
    """Without `Waypoint_1_p` where `Waypoint_1_q` is wanted and there, or the reverse."""
    good = {point.name for point in points if point.name and not point.fault}
    return tuple(point for point in points if not (point.fault and point.name in good))
