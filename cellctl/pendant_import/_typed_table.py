"""A typed table as points: rows of cells, the meaning of each heading, and the required columns."""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import final

from cellctl.files import InputError, Problem
from cellctl.formats.spreadsheet_text import is_number, stated_separator
from cellctl.pendant_import._points import TABLE, Raw, RawList, lines_of

_SEPARATORS = {"\t": "tabs", ";": "semicolons", ",": "commas", " ": "spaces"}
_COMMENT = re.compile(r"^\s*//.*$|\s(?:#|//)\s.*$")
_NUMBERS_IN_A_ROW = 3
_ENOUGH = 500
"""Lines that are tried with each separator."""

LENGTHS = {
    "mm": "mm", "millimeter": "mm", "millimetre": "mm", "cm": "cm", "m": "m", "meter": "m", "metre": "m",
    "um": "um", "µm": "um", "μm": "um", "inch": "inch", "inches": "inch", "in": "inch", "zoll": "inch", '"': "inch",
}  # fmt: skip
ANGLES = {"deg": "deg", "degree": "deg", "degrees": "deg", "°": "deg", "grad": "deg", "rad": "rad", "radian": "rad"}
_UNITS = {**LENGTHS, **ANGLES}
_BRACKETED = re.compile(r"(?P<words>.*?)\s*(?:\[\s*(?P<a>[^\]]+?)\s*\]|\(\s*(?P<b>[^)]+?)\s*\)|/\s*(?P<c>\S+?))\s*")
_TRAILING = re.compile(r"(?P<words>.*?[^\W_])[\s_]+(?:in\s+)?(?P<a>mm|cm|um|µm|inch|deg|rad|°)\s*", re.IGNORECASE)
_WORDS = re.compile(r"[a-zäöüßθσ]+|\d+", re.IGNORECASE)
_NAMES = {
    "name", "names", "nr", "no", "num", "number", "nummer", "punkt", "punktnummer", "punktname", "pkt", "pt", "point",
    "points", "id", "label", "bezeichnung", "p",
    "pos", "position", "messpunkt", "target", "targets", "feature",
}  # fmt: skip
_GROUPS = {"collection", "group", "gruppe"}
_POSITION = {
    "pos", "position", "coord", "coordinate", "koordinate", "wert", "value", "measured", "measurement", "meas",
    "actual", "act", "ist", "gemessen", "messwert", "tracker", "tcp", "point", "punkt",
}  # fmt: skip
_JOINT = re.compile(r"(?:joint|achse|axis|gelenk|theta|θ|[ajq])[\s_.-]*(?:angle|pos|position|winkel)?[\s_.-]*(\d{1,2})")
_ORIENTATION = {"A", "B", "C", "QW", "QX", "QY", "QZ", "RX", "RY", "RZ"}
_REMARKS = {
    "remark",
    "remarks",
    "bemerkung",
    "bemerkungen",
    "comment",
    "comments",
    "kommentar",
    "note",
    "notes",
    "notiz",
}
_SIGMA = {"s", "sigma", "σ", "std", "stdev", "stddev", "standard", "standardabweichung"}
_DEVIATION = {"dev", "deviation"}
_UNCERTAINTY = {"u", "unc", "uncertainty", "uncertainties", "unsicherheit"}
_ONE_WORD = re.compile(r"(?P<kind>sigma|std|unc|[suσ])(?P<axis>[xyz])", re.IGNORECASE)
_TIMES = {"time", "stamp", "timestamp", "zeit", "uhrzeit", "zeitstempel", "measured", "measurement"}
_DATES = {"date", "datum"}

_NAMING = ("collection", "group", "name")
"""Columns before the numbers of a table without headings, from the right."""
_OPTIONAL = ("sX", "sY", "sZ", "UX", "UY", "UZ", "collection", "group", "date", "time")


@final
@dataclass(frozen=True, slots=True)
class Row:
    """One row: its line, its cells (empty ones at the end are left out), and how many of them are numbers."""

    line: int
    cells: tuple[str, ...]
    numbers: int
    remark: str = ""


@final
@dataclass(frozen=True, slots=True)
class Cells:
    """A table as cells. separated: the separator, in words. notes: lines that begin with `//`, with their number."""

    file: str
    rows: tuple[Row, ...]
    separated: str
    notes: tuple[tuple[int, str], ...] = ()


def cells_of(text: str, file: str) -> Cells:
    """The rows that are not empty. Raises InputError where no separator gives rows with three numbers."""
    lines = [(number, line) for number, line in enumerate(lines_of(text), 1) if line.strip()]
    stated = stated_separator(lines[0][1].removeprefix("\ufeff")) if lines else None
    tried = [stated] if stated else list(_SEPARATORS)
    lines = lines[bool(stated) :]
    good = {mark: sum(row.numbers >= _NUMBERS_IN_A_ROW for row in _rows(lines[:_ENOUGH], mark)) for mark in tried}
    mark = max(tried, key=lambda each: good[each])
    if not good[mark]:
        what = "holds no row with three numbers, whatever separates the columns: tabs, semicolons, commas or spaces"
        cure = "separate the columns by semicolons or tabs; commas cannot be decimal sign and separator at once"
        raise InputError(Problem(file, 0, 0, what, cure))
    notes = tuple((number, line.strip(" \t/")) for number, line in lines if line.lstrip().startswith("//"))
    return Cells(file, tuple(_rows(lines, mark)), _SEPARATORS.get(mark, f"'{mark}'"), notes)


def _rows(lines: list[tuple[int, str]], mark: str) -> list[Row]:
    rows = [_row(number, line, mark) for number, line in lines]
    return [row for row in rows if any(row.cells)]


def _split_line(text: str, mark: str) -> list[str]:
    if mark == " ":
        return text.split()
    try:
        return next(csv.reader([text], delimiter=mark), [])
    except csv.Error:  # a cell is longer than CSV allows
        return text.split(mark)


def _row(number: int, line: str, mark: str) -> Row:
    comment = _COMMENT.search(line) if not line.lstrip().startswith("#") else None
    text = line[: comment.start()] if comment else line
    cells = [cell.strip() for cell in _split_line(text, mark)]
    while cells and not cells[-1]:
        cells.pop()
    numbers = sum(is_number(cell, spaced=mark not in ", ") for cell in cells)
    return Row(number, tuple(cells), numbers, comment[0].strip(" \t#/") if comment else "")


@final
@dataclass(frozen=True, slots=True)
class Heading:
    """A column: which of the data set's it is (`name`, `A1`, `J1`, `q1`, `X`, …; empty: unknown), unit or empty.

    `UX`…: an uncertainty of unknown coverage. `collection`, `group`, `date`: parts of a name or a time.
    """

    column: str
    unit: str = ""


def heading(text: str) -> Heading:
    """The meaning of a heading. `J…`: a joint whose heading does not state degrees or radians."""
    words, unit = _split_heading(text)
    letters = [word.casefold() for word in _WORDS.findall(words)]
    if words.strip() == "#" or (letters and set(letters) <= _NAMES):
        return Heading("name")
    if part := _part_of_name_or_time(set(letters)):
        return Heading(part)
    axes = [word for word in letters if word in ("x", "y", "z")]
    if spread := _spread(words, letters, axes):
        return Heading(spread, unit)
    if len(axes) == 1 and set(letters) - set(axes) <= _POSITION and unit not in ANGLES.values():
        return Heading(axes[0].upper(), unit)
    joint = _JOINT.fullmatch(words.strip(" #").casefold())
    if joint and unit not in LENGTHS.values():
        letter = words.strip(" #")[0]
        return Heading(
            f"{'A' if letter in 'Aa' and _is_a(words) else 'q' if letter == 'q' else 'J'}{int(joint[1])}", unit
        )
    plain = words.strip().upper()
    if plain in _ORIENTATION:
        return Heading(plain, unit)
    return Heading("remark" if letters and set(letters) <= _REMARKS else "", unit)


def _part_of_name_or_time(letters: set[str]) -> str:
    """`collection`, `group`, `name` (of `Collection::Group::Point`), `time` or `date`, empty where it is none."""
    if letters & _GROUPS:
        if letters & _NAMES - {"name", "names"}:
            return "name" if letters <= _GROUPS | _NAMES else ""
        return ("collection" if "collection" in letters else "group") if letters <= _GROUPS | {"name"} else ""
    if letters & (_TIMES - {"measured", "measurement"}) and letters <= _TIMES | _DATES:
        return "time"
    return "date" if letters and letters <= _DATES else ""


def _spread(words: str, letters: Sequence[str], axes: Sequence[str]) -> str:
    """`sX`… for a standard deviation, `UX`… for an uncertainty of unknown coverage; empty where it is neither.

    `Deviation X` and `Dev X` are neither: actual minus nominal.
    """
    one = _ONE_WORD.fullmatch(words.strip(" #"))
    if one:
        return f"{'U' if one['kind'].casefold() in _UNCERTAINTY else 's'}{one['axis'].upper()}"
    rest = set(letters) - set(axes)
    if len(axes) != 1:
        return ""
    if rest & _SIGMA and rest <= _SIGMA | _DEVIATION:
        return f"s{axes[0].upper()}"
    return f"U{axes[0].upper()}" if rest & _UNCERTAINTY and rest <= _UNCERTAINTY | {"coordinate"} else ""


def is_units_row(cells: Sequence[str]) -> bool:
    """Whether a row under the headings states units: `;mm;mm;mm`, `[mm]`."""
    filled = [cell for cell in cells if cell]
    return bool(filled) and all(cell.strip("[]() ").casefold() in _UNITS for cell in filled)


def unit_of(cell: str) -> str:
    """The unit stated by a cell of a units row."""
    return _UNITS.get(cell.strip("[]() ").casefold(), "")


def places(cells: Sequence[str], columns: Mapping[str, str]) -> dict[str, list[tuple[int, str]]]:
    """Columns of the data set → their places in a row of headings, with the unit. columns: what the user named."""
    named = {source.casefold(): target for target, source in columns.items()}
    found: dict[str, list[tuple[int, str]]] = {}
    for place, cell in enumerate(cells):
        target = named.get(cell.casefold())
        stated = Heading(target, _split_heading(cell)[1]) if target else heading(cell)
        if stated.column and (target or stated.column not in columns):
            found.setdefault(stated.column, []).append((place, stated.unit))
    return found


def _is_a(words: str) -> bool:
    return re.fullmatch(r"#?\s*[Aa][\s_.-]*\d+", words.strip()) is not None


def _split_heading(text: str) -> tuple[str, str]:
    """A heading's words, and its unit where it states a known one."""
    for pattern in (_BRACKETED, _TRAILING):
        found = pattern.fullmatch(text.strip())
        if found:
            unit = next(each for name, each in found.groupdict().items() if name != "words" and each)
            if unit.casefold() in _UNITS:
                return found["words"], _UNITS[unit.casefold()]
    return text, ""


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
    return RawList(table.file, TABLE, points, head.units, decided, head.line)


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
