"""A typed table as points: the required columns, found by their headings or, without any, by their number."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import final

from cellctl.files import InputError, Problem
from cellctl.formats.spreadsheet_text import is_number
from cellctl.pendant_import.cells import Cells, Row
from cellctl.pendant_import.headings import is_units_row, places, unit_of
from cellctl.pendant_import.points import Raw, RawList

_NAMING = ("collection", "group", "name")
"""Columns before the numbers of a table without headings, from the right."""
_OPTIONAL = ("sX", "sY", "sZ", "UX", "UY", "UZ", "collection", "group", "date", "time")


@final
@dataclass(frozen=True, slots=True)
class Headed:
    """A table's columns: place and unit of each, the headings' line (0: none), and the rows below."""

    places: Mapping[str, int]
    units: Mapping[str, str]
    line: int
    rows: tuple[Row, ...]
    width: int = 0
    decided: tuple[str, ...] = ()
    headings: tuple[str, ...] = ()


def headed(table: Cells, columns: Mapping[str, str], wanted: Sequence[str]) -> Headed | None:
    """The columns by headings; None where no row holds headings of any column in `wanted`.

    Raises InputError where a column occurs more than once.
    """
    for index, row in enumerate(table.rows):
        found = places(row.cells, columns)
        if row.numbers or not any(name in found for name in wanted):
            continue
        several = {name: at for name, at in found.items() if len(at) > 1 and name != "remark"}
        if several:
            raise InputError(
                _several(table.file, row, name, [place for place, _ in at]) for name, at in several.items()
            )
        return _below(table, index, _first(found))
    return _noted(table, columns, wanted)


def _noted(table: Cells, columns: Mapping[str, str], wanted: Sequence[str]) -> Headed | None:
    """The columns by headings in a comment: `// Collection, Group, Point, X, Y, Z`, if they are as many as cells."""
    width = Counter(len(row.cells) for row in table.rows).most_common(1)[0][0]
    for line, note in table.notes:
        cells = tuple(cell.strip() for cell in re.split(r"[,;\t]" if re.search(r"[,;\t]", note) else r"\s+", note))
        found = places(cells, columns)
        if len(cells) == width and any(name in found for name in wanted) and all(len(at) == 1 for at in found.values()):
            head = _below(replace(table, rows=(Row(line, cells, 0), *table.rows)), 0, _first(found))
            return replace(head, decided=(f"headings in the comment on line {line}", *head.decided))
    return None


def optional_columns(head: Headed) -> list[str]:
    """The columns of an instrument's file that are taken where they are there: σ, uncertainties, groups, times."""
    return [name for name in _OPTIONAL if name in head.places]


def _first(found: Mapping[str, list[tuple[int, str]]]) -> dict[str, tuple[int, str]]:
    return {name: at[0] for name, at in found.items()}


def _several(file: str, row: Row, name: str, at: list[int]) -> Problem:
    those = ", ".join(f"'{row.cells[place]}'" for place in at)
    what = f"{len(at)} columns could be {name}: {those}"
    return Problem(file, row.line, 0, what, f"say which: --columns {name}={row.cells[at[-1]]!r}".replace("'", '"'))


def _below(table: Cells, index: int, found: dict[str, tuple[int, str]]) -> Headed:
    rows, heading = table.rows[index + 1 :], table.rows[index]
    at = {name: place for name, (place, _) in found.items()}
    units = {name: unit for name, (_, unit) in found.items() if unit}
    if "name" not in at and not heading.cells[0] and 0 not in at.values():
        at["name"] = 0
    if rows and is_units_row(rows[0].cells):
        cells, rows = rows[0].cells, rows[1:]
        units |= {name: unit_of(cells[place]) for name, place in at.items() if place < len(cells) and cells[place]}
    above = [str(row.line) for row in table.rows[:index]]
    skipped = (f"skipped above the headings: line {', '.join(above)}",) if above else ()
    return Headed(at, units, heading.line, rows, len(heading.cells), skipped, heading.cells)


def lacking(file: str, head: Headed, names: Sequence[str], columns: Mapping[str, str]) -> Problem:
    """The columns `names` are missing: the user's names for them, and the existing columns."""
    called = ", ".join(f"{name} ('{columns[name]}')" if name in columns else name for name in names)
    here = f"columns here: {', '.join(head.headings)}; " if head.headings else ""
    return Problem(file, head.line, 0, f"has no column {called}", f"{here}--columns {names[0]}=HEADING names one")


def unheaded(table: Cells, layouts: Sequence[Sequence[str]], cure: str) -> Headed:
    """The columns of a table without headings, from the one of `layouts` that fits, with or without a name before it.

    Raises InputError where none fits, or more than one, or where the headings are all unknown.
    """
    first = table.rows[0]
    if not first.numbers:
        what = f"no heading says which column is which: {', '.join(cell for cell in first.cells if cell)}"
        raise InputError(Problem(table.file, first.line, 0, what, cure))
    lead = _words_before(table.rows)
    count, _ = Counter(row.numbers for row in table.rows).most_common(1)[0]
    numbered = lead < len(_NAMING) and _counts(table.rows, lead)
    fitting = []
    for layout in layouts:
        if len(layout) == count:
            fitting.append([*_NAMING[len(_NAMING) - lead :], *layout])
        if numbered and len(layout) + 1 == count:
            fitting.append([*_NAMING[len(_NAMING) - lead - 1 :], *layout])
    if len(fitting) != 1:
        kind = "a name and " if lead else ""
        what = f"has no headings, and rows of {kind}{count} numbers: which is which is not certain"
        raise InputError(Problem(table.file, table.rows[0].line, 0, what, cure))
    at = {name: place for place, name in enumerate(fitting[0])}
    return Headed(at, {}, 0, table.rows, len(at), (f"no headings: columns taken as {', '.join(at)}",))


def _words_before(rows: Sequence[Row]) -> int:
    """How many columns before the numbers hold words in most rows: a name, or collection, group and name."""
    for place in range(len(_NAMING)):
        words = sum(len(row.cells) > place and not is_number(row.cells[place]) for row in rows)
        if words * 2 <= len(rows):
            return place
    return len(_NAMING)


def _counts(rows: Sequence[Row], place: int) -> bool:
    """Whether this column can be a number of the point: whole numbers, almost all different."""
    found = [row.cells[place] if len(row.cells) > place else "" for row in rows]
    return all(cell.isdecimal() for cell in found) and len(set(found)) * 2 > len(found) and len(found) > 1


def raw_points(table: Cells, head: Headed, taken: Sequence[str]) -> RawList:
    """The rows as points with the texts of the columns `taken`; a row with too few or too many cells has a fault."""
    points = tuple(_raw(row, head, taken) for row in head.rows)
    decided = (f"columns separated by {table.separated}", *head.decided)
    return RawList(table.file, "table", points, head.units, decided, head.line)


def _raw(row: Row, head: Headed, taken: Sequence[str]) -> Raw:
    cells = row.cells
    name = cells[head.places["name"]] if "name" in head.places and head.places["name"] < len(cells) else ""
    beyond = [cell for cell in cells[head.width :] if cell]
    words = [cells[head.places["remark"]]] if head.places.get("remark", len(cells)) < len(cells) else []
    remark = " ".join([*words, *beyond, row.remark]).strip()
    if any(is_number(cell) for cell in beyond):
        return Raw(row.line, name, {}, f"{len(cells)} cells for {head.width} columns", remark)
    texts = {column: cells[head.places[column]] if head.places[column] < len(cells) else "" for column in taken}
    return Raw(row.line, name, texts, remark=remark)
