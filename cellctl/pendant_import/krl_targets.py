"""Cartesian points of a KRL file: E6POS and POS, declared, assigned or in a motion; mm and degrees."""

from __future__ import annotations

import re

from cellctl.krl import CARTESIAN, KrlFile, Point, motion_frames
from cellctl.pendant_import.points import Taught

_DATA = ("$", "BASE_DATA", "TOOL_DATA")
_PROGRAM = re.compile(
    r"^\s*(?:&ACCESS\b|(?:GLOBAL\s+)?DEF\s+\w+\s*\([^)\n]*\)\s*(?:;.*)?$)|\{\s*(?:\w+\s*:)?\s*X\s+[-+.\d]",
    re.IGNORECASE | re.MULTILINE,
)


def is_krl_program(text: str) -> bool:
    """Whether `text` is a KRL program, or holds a pose; `is_krl` tells data lists and joints."""
    return _PROGRAM.search(text) is not None


def krl_targets(text: str) -> list[Taught]:
    """The points in the order of the file. One that is not complete, or not a motion's point, carries the reason.

    The frame of `XP1` is the base of `FP1`, that of a point in a motion the motion's, where the file has it. Bases and
    tools are no points.
    """
    file = KrlFile.parse(text.encode("latin-1", "replace"), "")
    bases = {moved.motion.line: moved.base.number for moved in motion_frames(file) if not moved.base.reason}
    points = [point for point in file.points if not point.key.startswith(_DATA)]
    return [_point(point, _base(file, point) if point.name else bases.get(point.line)) for point in points]


def _base(file: KrlFile, point: Point) -> int | None:
    data = file.frame_data(f"F{point.key.removeprefix('X')}")
    return data.base_no if data else None


def _point(point: Point, base: int | None) -> Taught:
    texts = {label: repr(value) for label, value in point.values.items()}
    if point.is_joints:
        return Taught(point.line, point.name, point.type, texts, fault=point.fault)
    missing = f"{', '.join(point.missing)} missing: not a whole pose" if point.missing else ""
    framed = "FRAME is no point of a motion" if point.type == "FRAME" and point.name else ""
    if fault := point.fault or framed or missing:
        return Taught(point.line, point.name, point.type, fault=fault)
    pose = {label: texts[label] for label in CARTESIAN} | ({} if base is None else {"frame": f"BASE {base}"})
    return Taught(point.line, point.name, point.type, pose=pose)
