"""Points as lists of numbers: a UR script, a pose list, `[0.1, -1.2, …]` lines.

Source: Universal Robots, script manual, module motion: joints in rad; a pose `p[x, y, z, rx, ry, rz]` is a position in
m and an axis-angle vector in rad.
"""

from __future__ import annotations

import re
from math import radians

from cellctl.pendant_import._points import Taught, unified

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
