"""Joint lists as lists of numbers: a UR script, a pose list, `[0.1, -1.2, …]` lines."""

from __future__ import annotations

import re

from cellctl.pendant_import.points import Raw, RawList

_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_ITEM = rf"\s*(?:d2r\(\s*{_NUMBER}\s*\)|{_NUMBER})\s*"
_LIST = re.compile(rf"(?:(?P<pose>\bp)\s*)?\[(?P<body>{_ITEM}(?:,{_ITEM})+)\]")
_NAMED = re.compile(r"""^\s*(?:global\s+|local\s+)?["']?(?P<name>[A-Za-z0-9_][\w.-]*)["']?\s*(?::=|[=:;,\t])\s*$""")
_CALL = re.compile(r"(?P<name>\w+)\s*\([^()]*$")
_MOVES = {"movej", "movel", "movep", "movec", "servoj", "get_forward_kin"}
_SIZES = (6, 7)


def is_number_lists(text: str) -> bool:
    """Whether `text` holds bracketed lists of six numbers or more."""
    return any(found["body"].count(",") >= _SIZES[0] - 1 for found in _LIST.finditer(text))


def list_points(text: str, file: str, joints: int | None) -> RawList:
    """Joint lists in their order, radians (`d2r(90)` too). joints: how many the robot has; None: six or seven.

    `p[…]` is a Cartesian pose and carries the reason, unless the joints of the same waypoint are there. Lists in other
    calls than moves (payload, tool, speeds) are passed over.
    """
    code = re.sub(r"#[^\n\r]*", lambda comment: " " * len(comment[0]), text)
    points: list[Raw] = []
    for found in _LIST.finditer(code):
        before = code[max(code.rfind("\n", 0, found.start()), code.rfind("\r", 0, found.start())) + 1 : found.start()]
        call = _CALL.search(before)
        if call and call["name"] not in _MOVES:
            continue
        items = found["body"].split(",")
        line = len(re.findall(r"\r\n|\n|\r", code[: found.start()])) + 1
        points += _point(line, _NAMED.match(before), found["pose"] is not None, items, joints)
    with_joints = {point.name for point in points if point.name and not point.fault}
    kept = tuple(point for point in points if not (point.fault and point.name in with_joints))
    axes = sorted({label for point in kept for label in point.texts})
    return RawList(file, "lists", kept, dict.fromkeys(axes, "rad"), ("lists of numbers, radians, decimal point",))


def _point(line: int, named: re.Match[str] | None, pose: bool, items: list[str], joints: int | None) -> list[Raw]:
    name = re.sub(r"_[pq]$", "", named["name"]) if named else ""
    if pose:
        return [Raw(line, name, {}, "p[…] is a Cartesian pose: joint readings are needed")]
    wanted = (joints,) if joints else _SIZES
    if len(items) not in wanted:
        numbers = " or ".join(str(size) for size in wanted)
        return [Raw(line, name, {}, f"a list of {len(items)} numbers: a posture has {numbers}")]
    return [Raw(line, name, {f"q{place}": _radians(item) for place, item in enumerate(items, 1)})]


def _radians(item: str) -> str:
    degrees = re.fullmatch(r"\s*d2r\(\s*(\S+?)\s*\)\s*", item)
    if degrees is None:
        return item.strip()
    from math import radians

    return repr(radians(float(degrees[1])))
