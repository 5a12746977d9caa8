"""Points as lists of numbers: a UR script, a pose list, `[0.1, -1.2, …]` lines.

Source: Universal Robots, script manual, module motion: joints in rad; a pose `p[x, y, z, rx, ry, rz]` is a position in
m and an axis-angle vector in rad.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from math import radians

from cellctl.pendant_import._language import Language, Targets, postures_of, targets_of
from cellctl.pendant_import._points import RawList, Source, Taught, unified

_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_ITEM = rf"\s*(?:d2r\(\s*{_NUMBER}\s*\)|{_NUMBER})\s*"
_LIST = re.compile(rf"(?:(?P<pose>\bp)\s*)?\[(?P<body>{_ITEM}(?:,{_ITEM})+)\]")
_NAMED = re.compile(r"""^\s*(?:global\s+|local\s+)?["']?(?P<name>[A-Za-z0-9_][\w.-]*)["']?\s*(?::=|[=:;,\t])\s*$""")
_CALL = re.compile(r"(?P<name>\w+)\s*\([^()]*$")
_MOVES = {"movej", "movel", "movep", "movec", "servoj", "get_forward_kin", "get_inverse_kin"}
_SIZES = (6, 7)
_POSE = ("X", "Y", "Z", "RX", "RY", "RZ")


def is_number_lists(text: str) -> bool:
    """Whether `text` holds bracketed lists of six numbers or more."""
    return any(found["body"].count(",") >= _SIZES[0] - 1 for found in _LIST.finditer(text))


def script_points(text: str, joints: int | None) -> list[Taught]:
    """Joint lists in radians (`d2r(90)` too) and poses, in their order. joints: how many the robot has; None: 6 or 7.

    Lists in other calls than moves (payload, tool, speeds) are passed over.
    """
    code = re.sub(r"#[^\n]*", lambda comment: " " * len(comment[0]), unified(text))
    points: list[Taught] = []
    for found in _LIST.finditer(code):
        before = code[code.rfind("\n", 0, found.start()) + 1 : found.start()]
        call = _CALL.search(before)
        if call and call["name"] not in _MOVES:
            continue
        line = 1 + code.count("\n", 0, found.start())
        points.append(_point(line, _NAMED.match(before), found["pose"] is not None, found["body"].split(","), joints))
    return points


def _point(line: int, named: re.Match[str] | None, pose: bool, items: list[str], joints: int | None) -> Taught:
    name = re.sub(r"_[pq]$", "", named["name"]) if named else ""
    kind = "p[…]" if pose else "a list of joints"
    wanted = (len(_POSE),) if pose else (joints,) if joints else _SIZES
    if len(items) not in wanted:
        numbers = " or ".join(str(size) for size in wanted)
        what = f"a list of {len(items)} numbers: a {'pose' if pose else 'posture'} has {numbers}"
        return Taught(line, name, kind, fault=what)
    texts = [_radians(item) for item in items]
    if pose:
        return Taught(line, name, kind, pose=dict(zip(_POSE, texts, strict=True)))
    return Taught(line, name, kind, {f"q{place}": text for place, text in enumerate(texts, 1)})


def _radians(item: str) -> str:
    degrees = re.fullmatch(r"\s*d2r\(\s*(\S+?)\s*\)\s*", item)
    if degrees is None:
        return item.strip()
    return repr(radians(float(degrees[1])))


_SOURCE = Source("lists", decimal_point=True)


def _postures(text: str, file: str, joints: int | None) -> RawList | None:
    if not is_number_lists(text):
        return None
    words = ["lists of numbers, radians, decimal point"]
    return postures_of(file, _SOURCE, script_points(text, joints), words, "rad")


def _targets(text: str, file: str) -> Targets | None:
    if not is_number_lists(text):
        return None
    points = script_points(text, None)
    words = ["poses p[…], m and rotation vectors in rad, decimal point"]
    return _with_postures(Targets(targets_of(file, _SOURCE, points, words), "rotation-vector", "m"), points)


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


NUMBER_LISTS = Language(postures=_postures, targets=_targets)
