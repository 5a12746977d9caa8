"""Joint lists of a KUKA controller: points of a KRL data list or program, and listings of $AXIS_ACT."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import TYPE_CHECKING

from cellctl.pendant_import.points import Raw, RawList
from cellctl.pendant_import.text import lines_of

if TYPE_CHECKING:
    from collections.abc import Iterator

_KRL = re.compile(r"\{[^{}\n]*\b[AE]\d\s|\bE6AXIS\b|\bE6POS\b|\bDEFDAT\b", re.IGNORECASE)
_DECLARED = r"\b(?P<type>E6AXIS|AXIS|E6POS|POS|FRAME)\b"
_POINT = re.compile(
    rf"(?:{_DECLARED}\s+)?(?:(?P<name>\$?[A-Za-z_][\w$]*(?:\s*\[[\d\s,]*\])?)\s*=\s*)?\{{(?P<body>[^{{}}]*)\}}",
    re.IGNORECASE,
)
_UNTAUGHT = re.compile(rf"{_DECLARED}\s+(?P<name>\w+)\s*$", re.IGNORECASE)
_FIELD = re.compile(r"\s*(?P<label>[A-Za-z]\w*)\s+(?P<value>\S+)\s*")
_NUMBER = r"[-+]?(?:\d+(?:[.,]\d*)?|[.,]\d+)(?:[eE][-+]?\d+)?"
_LABEL = re.compile(
    rf"(?:\$AXIS_ACT\w*\s*\.\s*)?(?<![A-Za-z0-9_])(?P<label>[AE]\d)\s*[:=]?\s*(?={_NUMBER})", re.IGNORECASE
)
_LISTING = re.compile(
    rf"(?<!\w)A1\s*[:=]?\s*{_NUMBER}\s*(?:°|deg)?[\s,;]*(?:\$AXIS_ACT\w*\s*\.\s*)?A2\s*[:=]?\s*{_NUMBER}", re.IGNORECASE
)
_AXIS = re.compile(r"[AE]\d")


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
    points = []
    for line, written in enumerate(lines_of(text), 1):
        code = written.partition(";")[0]
        points += list(_points_of(code, line))
    return RawList(file, "krl", tuple(points), dict.fromkeys(_axes(points), "deg"), ("KRL, degrees, decimal point",))


def _points_of(code: str, line: int) -> Iterator[Raw]:
    untaught = _UNTAUGHT.search(code)
    if untaught:
        yield Raw(line, untaught["name"], {}, f"{untaught['type'].upper()} without a value: not taught")
    for found in _POINT.finditer(code):
        name = re.sub(r"\s+", "", found["name"] or "")
        point = _point(line, name, (found["type"] or "").upper(), found["body"])
        if point:
            yield _actual(point)
    rest = _POINT.sub("", code)
    if re.search(r"\{[^{}]*\b[AEXYZ]\d?\s", rest):
        yield Raw(line, "", {}, "a point that does not end on this line: '}' is missing")


def _point(line: int, name: str, kind: str, body: str) -> Raw | None:
    """The point of an aggregate; None where it is not a point."""
    typed = re.match(r"\s*(\w+)\s*:", body)
    fields, faults = _fields(body[typed.end() :] if typed else body)
    kind = typed[1].upper() if typed else kind
    axes = {label: value for label, value in fields.items() if _AXIS.fullmatch(label)}
    if {"X", "Y", "Z"} & fields.keys() or kind in ("E6POS", "POS", "FRAME"):
        return Raw(line, name, {}, f"{kind or 'a position'} is Cartesian: joint readings are needed (E6AXIS)")
    if "A1" not in axes and kind not in ("E6AXIS", "AXIS"):
        return None
    return Raw(line, name, axes, faults)


def _actual(point: Raw) -> Raw:
    """A system variable is a point, without a name, only if it holds axis angles."""
    if not point.name.startswith("$"):
        return point
    if point.fault or point.name.upper().startswith("$AXIS_ACT"):
        return replace(point, name="")
    return replace(point, texts={}, fault=f"{point.name} does not say where the axes were: $AXIS_ACT does")


def _fields(body: str) -> tuple[dict[str, str], str]:
    fields: dict[str, str] = {}
    for part in body.split(","):
        found = _FIELD.fullmatch(part)
        if found is None:
            return fields, f"'{part.strip()}' is not 'A1 12.5': KRL has decimal points, commas between the axes"
        label = found["label"].upper()
        if label in fields:
            return fields, f"{label} is given twice"
        fields[label] = found["value"]
    return fields, ""


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
    return RawList(file, "listing", tuple(points), dict.fromkeys(_axes(points), "deg"), ("listing of axes, degrees",))


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
