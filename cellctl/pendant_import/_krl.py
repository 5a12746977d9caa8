"""Points of a KUKA controller: of a KRL data list or program, as postures or targets, and listings of $AXIS_ACT."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace

from cellctl.krl import (
    CARTESIAN,
    Declaration,
    Declared,
    KrlFile,
    Point,
    Unknown,
    aggregate_in,
    motion_frames,
    point_of,
    points_of,
    statements,
)
from cellctl.pendant_import._language import Language, Targets, targets_of
from cellctl.pendant_import._points import Raw, RawList, Source, Taught, lines_of

_SOURCE = Source("krl", decimal_point=True, x_before_names=True)

_KRL = re.compile(r"\{[^{}\n]*\b[AE]\d\s|\bE6AXIS\b|\bE6POS\b|\bDEFDAT\b", re.IGNORECASE)
_NUMBER = r"[-+]?(?:\d+(?:[.,]\d*)?|[.,]\d+)(?:[eE][-+]?\d+)?"
_LABEL = re.compile(
    rf"(?:\$AXIS_ACT\w*\s*\.\s*)?(?<![A-Za-z0-9_])(?P<label>[AE]\d)\s*[:=]?\s*(?={_NUMBER})", re.IGNORECASE
)
_LISTING = re.compile(
    rf"(?<!\w)A1\s*[:=]?\s*{_NUMBER}\s*(?:°|deg)?[\s,;]*(?:\$AXIS_ACT\w*\s*\.\s*)?A2\s*[:=]?\s*{_NUMBER}", re.IGNORECASE
)
_POINT_TYPES = ("E6AXIS", "AXIS", "E6POS", "POS", "FRAME")
_POINT_BEGINS = re.compile(r"\{[^{}]*\b[AEXYZ]\d?\s", re.IGNORECASE)


def is_krl(text: str) -> bool:
    """Whether `text` holds KRL points or declarations."""
    return _KRL.search(text) is not None


def is_axis_listing(text: str) -> bool:
    """Whether `text` lists `A1 number, A2 number, …`, on one line or on several, without braces."""
    return _LISTING.search(text) is not None


def krl_points(text: str, file: str) -> RawList:
    """The points of a KRL file, in its order. Cartesian ones and those that cannot be read carry the reason.

    Comments and declarations other than points (FDAT, PDAT, LDAT, …) are skipped. `$AXIS_ACT={…}` is a point without a
    name.
    """
    read = statements(text)
    found = [(point.span, _raw(point, text)) for point in points_of(read)]
    for statement in read:
        if isinstance(statement, Declaration):
            found += [(variable.target.span, raw) for variable, raw in _untaught(statement)]
        elif isinstance(statement, Unknown) and _POINT_BEGINS.search(text[statement.span.start : statement.span.end]):
            found.append((statement.span, _not_understood(statement, text)))
    points = [_actual(raw) for _, raw in sorted(found, key=lambda item: item[0])]
    return RawList(file, _SOURCE, tuple(points), dict.fromkeys(_axes(points), "deg"), ("KRL, degrees, decimal point",))


def _raw(point: Point, text: str) -> Raw:
    if not point.is_joints:
        return Raw(point.line, point.name, {}, f"{point.type} is Cartesian: joint readings are needed (E6AXIS)")
    texts = {label: text[number.span.start : number.span.end] for label, number in point.numbers.items()}
    return Raw(point.line, point.name, texts, point.fault)


def _untaught(declaration: Declaration) -> Iterator[tuple[Declared, Raw]]:
    """Points that are declared without a value; an array gets its values elsewhere."""
    fault = f"{declaration.type} without a value: not taught"
    for variable in declaration.variables if declaration.type in _POINT_TYPES else ():
        if variable.value is None and not variable.target.path:
            yield variable, Raw(declaration.line, variable.target.name, {}, fault)


def _not_understood(statement: Unknown, text: str) -> Raw:
    """A point on a line that is no statement of KRL: values alone are read, anything else has the reason."""
    value = None if statement.name else aggregate_in(text, statement.span)
    point = point_of(value, statement.line) if value else None
    return _raw(point, text) if point else Raw(statement.line, statement.name, {}, statement.reason)


def _actual(point: Raw) -> Raw:
    """A system variable is a point, without a name, only if it holds axis angles."""
    if not point.name.startswith("$"):
        return point
    if point.fault or point.name.upper().startswith("$AXIS_ACT"):
        return replace(point, name="")
    return replace(point, texts={}, fault=f"{point.name} does not say where the axes were: $AXIS_ACT does")


def axis_listing(text: str, file: str) -> RawList:
    """Postures of a listing: several axes on a line are one posture, single ones are collected until one repeats.

    Text before the first axis, or alone on the line above, is the posture's name, except `$AXIS_ACT`.
    """
    points: list[Raw] = []
    gathered: dict[str, str] = {}
    start, name = 0, ""
    for line, written in enumerate([*lines_of(text), ""], 1):
        labelled = _labelled(written)
        if gathered and (len(labelled) != 1 or labelled.keys() & gathered.keys()):
            points.append(Raw(start, name, gathered))
            gathered, name = {}, ""
        if len(labelled) > 1:
            points.append(Raw(line, _name(_before(written)) or name, labelled))
            name = ""
        elif labelled:
            start, gathered = (line if not gathered else start), {**gathered, **labelled}
        elif written.strip():
            name = _name(written)
    return RawList(
        file, Source("listing"), tuple(points), dict.fromkeys(_axes(points), "deg"), ("listing of axes, degrees",)
    )


def _labelled(line: str) -> dict[str, str]:
    found = list(_LABEL.finditer(line))
    ends = [label.start() for label in found[1:]] + [len(line)] * bool(found)
    return {
        label["label"].upper(): re.sub(r"\s*(°|deg)?[\s,;}]*$", "", line[label.end() : end])
        for label, end in zip(found, ends, strict=True)
    }


def _before(line: str) -> str:
    first = _LABEL.search(line)
    return line[: first.start()] if first else line


def _name(text: str) -> str:
    return re.sub(r"\$AXIS_ACT\w*", "", text).strip(" \t:=,;-{[#")


def _axes(points: list[Raw]) -> list[str]:
    return sorted({label for point in points for label in point.texts})


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


def _postures(text: str, file: str, joints: int | None) -> RawList | None:
    return krl_points(text, file) if is_krl(text) else None


def _targets(text: str, file: str) -> Targets | None:
    if not is_krl(text) and not is_krl_program(text):
        return None
    return Targets(targets_of(file, _SOURCE, krl_targets(text), ["KRL, mm and degrees, decimal point"]), "abc")


KRL = Language(postures=_postures, targets=_targets)


def _listed(text: str, file: str, joints: int | None) -> RawList | None:
    return axis_listing(text, file) if is_axis_listing(text) else None


def _no_targets(text: str, file: str) -> None:
    """A listing has joints only."""


AXIS_LISTING = Language(postures=_listed, targets=_no_targets)
