"""What the files of measuring software say besides X, Y, Z: unit, frame, groups, σ, times, offsets of the target.

Facts: SpatialAnalyzer user's manual, "Exporting ASCII Formatted Points" and "Confidence Interval and Uncertainty
Display".
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

from cellctl.files import InputError, Problem
from cellctl.pendant_import._points import Point, PointList, Raw, RawList, Value
from cellctl.pendant_import._typed_table import LENGTHS, Cells, Headed
from cellctl.pendant_import.choices import Choices

SIGMA_COLUMNS = ("sX", "sY", "sZ")
UNCERTAINTIES = ("UX", "UY", "UZ")
_UNIT = re.compile(r"\b(?:units?|einheit(?:en)?)\b(?P<rest>.*)", re.IGNORECASE)
_FRAME = re.compile(r"\b(?:frame|coordinate system|koordinatensystem|working)\b", re.IGNORECASE)
_SYSTEM = re.compile(r"coord|koord|ax[ei]s|achsen|system", re.IGNORECASE)
_NOT_CARTESIAN = re.compile(r"\b(?:cylindric(?:al)?|spherical|polar|zylindrisch|sphärisch)", re.IGNORECASE)
_UNKNOWN_UNIT = re.compile(r"\b(?:feet|foot|ft|yards?)\b", re.IGNORECASE)
_OFFSET = re.compile(r"offset|reflector|probe|versatz|reflektor", re.IGNORECASE)


def preface(table: Cells, head: Headed) -> list[tuple[int, str]]:
    """The lines that are neither headings nor rows of numbers: comments, and lines above the headings."""
    first = head.rows[0].line if head.rows else 0
    above = [(row.line, " ".join(row.cells)) for row in table.rows if row.line < first and row.line != head.line]
    return sorted([*table.notes, *above])


def described(raw: RawList, table: Cells, head: Headed) -> RawList:
    """The list with the unit that a line above the rows states, and what such lines say of the frame.

    Raises InputError where they say that the coordinates are not Cartesian, or in a unit that is not known.
    """
    lines = [(line, text) for line, text in preface(table, head) if line != head.line]
    _refuse_unknown(raw.file, lines)
    framed = tuple(f"line {line} says '{text[:80]}'" for line, text in lines if _FRAME.search(text))
    offsets = [heading for heading in head.headings if heading and _OFFSET.search(heading)]
    if offsets:
        framed = (*framed, f"{', '.join(offsets)} not applied: X, Y, Z as the file has them")
    rest = [heading for place, heading in enumerate(head.headings) if place not in head.places.values()]
    if unused := [heading for heading in rest if heading and heading not in offsets]:
        framed = (*framed, f"columns not taken: {', '.join(unused[:12])}{', …' if len(unused) > 12 else ''}")
    stated = [(line, unit) for line, text in lines if (unit := _unit(text))]
    without = not any(raw.units.get(axis) for axis in "XYZ")
    units = {**dict.fromkeys("XYZ", stated[0][1]), **raw.units} if stated and without else raw.units
    by = f"line {stated[0][0]} says" if stated and without else raw.stated_by
    return replace(raw, units=units, stated_by=by, decided=(*raw.decided, *framed))


def _refuse_unknown(file: str, lines: Sequence[tuple[int, str]]) -> None:
    problems = [
        Problem(file, line, 0, f"the coordinates may not be Cartesian: '{text[:60]}'", "export them as X, Y, Z")
        for line, text in lines
        if _SYSTEM.search(text) and _NOT_CARTESIAN.search(text)
    ]
    problems += [
        Problem(file, line, 0, f"the unit is not known: '{text[:60]}'", "export in mm, cm, m, µm or inches")
        for line, text in lines
        if (stated := _UNIT.search(text)) and _UNKNOWN_UNIT.search(stated["rest"])
    ]
    if problems:
        raise InputError(problems)


def _unit(text: str) -> str:
    """The unit of length in `Units: Millimeters`, empty where there is none, or more than one."""
    found = _UNIT.search(text)
    words = re.findall(r"[a-zµμ]+", re.sub(r"\bin\s+(?=\w)", "", found["rest"].casefold())) if found else []
    units = {LENGTHS[each] for word in words for each in (word, word.removesuffix("s")) if each in LENGTHS}
    return next(iter(units)) if len(units) == 1 else ""


def of_group(raw: RawList, choices: Choices) -> RawList:
    """The points of the group that the user chose, each named by its last part, in one list.

    A name is `Collection::Group::Point`, or its parts are in columns. Raises InputError where points of several groups
    have one name, or where there is no such group.
    """
    points = [_parted(point) for point in raw.points]
    groups = list(dict.fromkeys(point.texts["group"] for point in points if point.texts.get("group")))
    if choices.group is not None:
        wanted = [group for group in groups if choices.group in (group, group.rpartition("::")[2])]
        if len(wanted) != 1:
            what = f"has {'no' if not wanted else 'more than one'} group '{choices.group}'"
            here = f"groups here: {', '.join(groups[:10])}" if groups else "its points are in no groups"
            raise InputError(Problem(raw.file, raw.heading_line, 0, what, here))
        points = [point for point in points if point.texts.get("group") == wanted[0]]
        return replace(raw, points=_ungrouped(points), decided=(*raw.decided, f"group {wanted[0]} only"))
    first: dict[str, Raw] = {}
    for point in points:
        other = first.setdefault(point.name, point)
        if point.name and other.texts.get("group") != point.texts.get("group"):
            what = f"{point.name} of group {point.texts.get('group')} is on line {other.line} too, of another group"
            raise InputError(Problem(raw.file, point.line, 0, what, f"--group NAME: {', '.join(groups[:10])}"))
    if len(groups) == 1:
        return replace(raw, points=_ungrouped(points), decided=(*raw.decided, f"points of group {groups[0]}"))
    return replace(raw, points=tuple(points))


def _parted(point: Raw) -> Raw:
    """The point with its last name, and collection and group together in the column `group`."""
    *before, name = [part.strip() for part in point.name.split("::")]
    columns = [point.texts.get(column, "") for column in ("collection", "group")]
    texts = {column: text for column, text in point.texts.items() if column not in ("collection", "group")}
    group = "::".join(part for part in (*columns, *before) if part)
    return replace(point, name=name, texts=texts | ({"group": group} if group else {}))


def _ungrouped(points: Sequence[Raw]) -> tuple[Raw, ...]:
    return tuple(replace(point, texts={k: text for k, text in point.texts.items() if k != "group"}) for point in points)


def with_times(raw: RawList) -> RawList:
    """The list with date and time in one column `time`."""

    def timed(texts: Mapping[str, str]) -> dict[str, str]:
        time = " ".join(texts[part] for part in ("date", "time") if texts.get(part))
        rest = {column: text for column, text in texts.items() if column not in ("date", "time")}
        return rest | ({"time": time} if time else {})

    return replace(raw, points=tuple(replace(point, texts=timed(point.texts)) for point in raw.points))


def with_sigmas(points: PointList, choices: Choices) -> PointList:
    """The list with its uncertainties as σ, where the user says how many σ they are; without those that are all 0."""
    columns = {column for point in points.points for column in point.values}
    stated = [name for name in UNCERTAINTIES if name in columns]
    decided = list(points.decided)
    if choices.coverage and not stated:
        cure = "leave --coverage out; columns of σ (sX, Std Dev X) need none"
        raise InputError(Problem(points.file, 0, 0, "has no uncertainties: no column Ux, Uy, Uz", cure))
    if choices.coverage:
        decided.append(f"σ of X, Y, Z: {', '.join(stated)} / {choices.coverage:g}, as --coverage says")
    elif stated:
        decided.append(f"{', '.join(stated)} not taken: --coverage says how many σ they are")
    found = [_with_sigma(point, choices.coverage) for point in points.points]
    if any(name in point.values for point in found for name in SIGMA_COLUMNS) and not any(
        point.values.get(name) for point in found for name in SIGMA_COLUMNS
    ):
        decided.append("σ not taken: all are 0")
        found = [_without(point, SIGMA_COLUMNS) for point in found]
    return replace(points, points=tuple(found), decided=tuple(decided))


def _with_sigma(point: Point, coverage: float | None) -> Point:
    texts = [name for name in (*SIGMA_COLUMNS, *UNCERTAINTIES) if isinstance(point.values.get(name), str)]
    if texts and not point.fault:
        return replace(point, fault=f"{texts[0]} '{str(point.values[texts[0]])[:20]}' is not a number")
    if coverage is None or point.fault:
        return _without(point, UNCERTAINTIES)
    sigmas: dict[str, Value] = {
        sigma: float(point.values[name]) / coverage
        for sigma, name in zip(SIGMA_COLUMNS, UNCERTAINTIES, strict=True)
        if name in point.values
    }
    bare = _without(point, UNCERTAINTIES)
    return replace(bare, values={**bare.values, **sigmas})


def _without(point: Point, names: Sequence[str]) -> Point:
    return replace(point, values={name: value for name, value in point.values.items() if name not in names})
