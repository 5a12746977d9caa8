"""Cartesian points of a KRL file: E6POS and POS of a data list or of a motion, X, Y, Z in mm, A, B, C in degrees."""

from __future__ import annotations

import re

from cellctl.pendant_import.points import Taught
from cellctl.pendant_import.text import lines_of

_AGGREGATE = re.compile(
    r"(?:\b(?P<type>E6AXIS|AXIS|E6POS|POS|FRAME)\s+)?(?:(?P<name>\$?[A-Za-z_][\w$]*(?:\s*\[[\d\s,]*\])?)\s*=\s*)?"
    r"\{\s*(?:(?P<typed>\w+)\s*:)?(?P<body>[^{}]*)\}",
    re.IGNORECASE,
)
_MOTION = re.compile(r"\s*(?:S?PTP|S?LIN|S?CIRC)\b", re.IGNORECASE)
_BASE = re.compile(r"\bF(?P<name>\w+)\s*=\s*\{[^}]*\bBASE_NO\s+(?P<base>\d+)", re.IGNORECASE)
_POSE = ("X", "Y", "Z", "A", "B", "C")


def krl_targets(text: str) -> list[Taught]:
    """The points in the order of the file. One that is not complete, or not a motion's point, carries the reason.

    The frame of `XP1` is the base of `FP1`, where the file has it.
    """
    lines = [written.partition(";")[0] for written in lines_of(text)]
    bases = {found["name"].upper(): found["base"] for line in lines for found in _BASE.finditer(line)}
    found = [(number, code, match) for number, code in enumerate(lines, 1) for match in _AGGREGATE.finditer(code)]
    points = [_point(number, match, _MOTION.match(code) is not None, bases) for number, code, match in found]
    return [point for point in points if point]


def _point(line: int, match: re.Match[str], moved: bool, bases: dict[str, str]) -> Taught | None:
    kind = (match["typed"] or match["type"] or "").upper()
    name = re.sub(r"\s+", "", match["name"] or "")
    fields = dict(re.findall(r"(?:^|,)\s*([A-Za-z]\w*)\s+([^,\s]+)", match["body"]))
    fields = {label.upper(): value for label, value in fields.items()}
    if kind in ("E6AXIS", "AXIS") or "A1" in fields:
        return Taught(line, name, kind or "an aggregate", fields)
    if not (kind in ("E6POS", "POS") or moved) or not fields.keys() & {*_POSE}:
        return None
    missing = [label for label in _POSE if label not in fields]
    if missing:
        return Taught(line, name, kind, fault=f"{', '.join(missing)} missing: not a whole pose")
    base = bases.get(name[1:].upper() if name[:1] in "Xx" else name.upper())
    frame = {"frame": f"BASE {base}"} if base else {}
    return Taught(line, name, kind or "an aggregate", pose={label: fields[label] for label in _POSE} | frame)
