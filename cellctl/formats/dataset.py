"""Data sets: CSV with a header; a column's name defines its meaning. Cells of a file stay text until they are used."""

from __future__ import annotations

import csv
import io
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self, TypeAlias, final

from cellctl.files import InputError, Problem, sha256_of, write_atomically
from cellctl.files.kinds import DATA_SET, kind_of, refuse_other_kind
from cellctl.formats.plain_text import decoded
from cellctl.formats.separated import named, separator, with_points

Cell: TypeAlias = str | int | float

DOCUMENT = "docs/reference/data-sets.md"


@final
@dataclass(frozen=True, slots=True)
class Rejected:
    """A row that cannot be used: its line in the file (from 1, the header's) and why."""

    line: int
    reason: str


@final
@dataclass(frozen=True)
class DataSet:
    """A data set. cells: of each usable row, in the order of `columns`: text from a file, or numbers made in memory;
    lines: each row's line in the file.
    """

    file: str
    columns: tuple[str, ...]
    cells: tuple[tuple[Cell, ...], ...]
    lines: tuple[int, ...]
    rejected: tuple[Rejected, ...] = ()
    sha256: str = ""
    _index: dict[str, int] = field(init=False, repr=False, default_factory=dict)

    def __post_init__(self) -> None:
        self._index.update({name: place for place, name in enumerate(self.columns)})

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read a data set. Raises InputError where the file as a whole cannot be used; single bad rows are rejected."""
        try:
            data = path.read_bytes()
        except OSError as error:
            refuse_other_kind(path, DATA_SET)
            raise InputError(Problem(str(path), 0, 0, f"cannot be read: {error.strerror}", "check the path")) from error
        text = decoded(data, str(path))
        refuse_other_kind(path, DATA_SET, kind_of(text))
        return cls.parse(text, str(path), sha256_of(data))

    @classmethod
    def parse(cls, text: str, file: str, sha256: str = "") -> Self:
        """A data set from its text; `file` names it in errors."""
        mark, said = separator(text)
        reader = csv.reader(io.StringIO(text, newline=""), delimiter=mark, strict=True)
        try:
            if said:
                next(reader)
            header, cells, lines, rejected = _read(reader, file)
        except csv.Error as error:
            raise InputError(_not_csv(file, text, reader.line_num, error)) from error
        if not cells and not rejected:
            raise _without_rows(file)
        if mark != ",":
            cells = with_points(header, cells, lines, file)
        return cls(file, header, tuple(cells), tuple(lines), tuple(rejected), sha256)

    @classmethod
    def of_records(cls, records: Iterable[Mapping[str, Any]], file: str = "measurements") -> Self:
        """A data set from rows in memory, with the columns of all; the lines are those that `write` gives them."""
        rows = list(records)
        if not rows:
            raise _without_rows(file)
        columns = _columns_of(rows)
        cells = tuple(tuple(_plain(row.get(name)) for name in columns) for row in rows)
        return cls(file, columns, cells, tuple(range(2, len(cells) + 2)))

    def __len__(self) -> int:
        return len(self.cells)

    def has(self, *names: str) -> bool:
        """Whether all of these columns exist."""
        return all(name in self._index for name in names)

    def texts(self, name: str) -> list[str]:
        """A column's cells as text, empty ones empty; all empty where there is no such column."""
        return [_text(value) for value in self.values(name)]

    def values(self, name: str) -> list[Cell]:
        """A column's cells, text or numbers; all empty text where there is no such column."""
        place = self._index.get(name)
        return [""] * len(self.cells) if place is None else [row[place] for row in self.cells]

    def text(self) -> str:
        """The usable rows as CSV, every column kept."""
        return _csv([self.columns, *(map(_text, row) for row in self.cells)])

    def write(self, path: Path) -> None:
        """Write the usable rows, every column kept. Raises OSError."""
        write_atomically(path, self.text())


def text_of(records: Sequence[Mapping[str, Any]]) -> str:
    """CSV of `records` with the union of their keys as columns; None and missing are empty cells, floats round-trip."""
    columns = _columns_of(records)
    return _csv([columns, *([_text(_plain(record.get(name))) for name in columns] for record in records)])


def _columns_of(records: Sequence[Mapping[str, Any]]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(name for record in records for name in record))


def _plain(value: Any) -> Cell:
    return "" if value is None else value if isinstance(value, int | float) else str(value)


def _text(value: Cell) -> str:
    return repr(float(value)) if isinstance(value, float) else str(value)


def _not_csv(file: str, text: str, line: int, error: csv.Error) -> Problem:
    """The error of the parser, at `line` or at a quote that is not closed."""
    match str(error):
        case "unexpected end of data":
            odd = [number for number, each in enumerate(text.splitlines(), 1) if each.count('"') % 2]
            return Problem(file, odd[-1] if odd else line, 0, "a quote is opened and not closed", "close or remove it")
        case words if "expected after" in words:
            return Problem(file, line, 0, "text follows a closing quote", "put the whole cell in quotes, or none of it")
        case words if "field larger" in words:
            return Problem(file, line, 0, "a cell is longer than any value can be", "check quotes and separators")
        case _:
            return Problem(file, line, 0, "this line is not CSV", "save the table again as CSV")


def _without_rows(file: str) -> InputError:
    return InputError(Problem(file, 0, 0, "holds no rows", "a header row and one row for each measurement"))


def _csv(rows: Iterable[Iterable[str]]) -> str:
    stream = io.StringIO()
    csv.writer(stream, lineterminator="\n").writerows(rows)
    return stream.getvalue()


def _read(reader: Any, file: str) -> tuple[tuple[str, ...], list[tuple[str, ...]], list[int], list[Rejected]]:
    """Header, rows, the line of each, and rows of another width. Empty rows are skipped."""
    whole = tuple(name.strip() for name in next(reader, []))
    header = whole[: named(whole)]
    _check_header(header, file, reader.line_num)
    cells, lines, rejected, before = [], [], [], reader.line_num
    for row in reader:
        line, before = before + 1, reader.line_num
        texts = tuple(cell.strip() for cell in row)
        own, beyond = texts[: len(header)], texts[len(header) :]
        if len(own) == len(header) and any(own) and not any(beyond):
            cells.append(own)
            lines.append(line)
        elif any(texts):
            nameless = len(own) == len(header) and len(row) == len(whole)
            what = "a value in a column without a name" if nameless else f"{len(row)} cells for {len(header)} columns"
            rejected.append(Rejected(line, what))
    return header, cells, lines, rejected


def _check_header(header: tuple[str, ...], file: str, line: int) -> None:
    if not any(header):
        raise InputError(Problem(file, 0, 0, "is empty", "a header row, then one row for each measurement"))
    if any("\0" in name for name in header):
        raise InputError(Problem(file, 0, 0, "is not text", "give a CSV file"))
    if len(header) == 1 and "|" in header[0]:
        what = "its columns are not separated by commas, semicolons or tabs"
        raise InputError(Problem(file, line, 1, what, f"convert it: {DOCUMENT} says how"))
    if 2 * sum(re.fullmatch(r"[-+]?[\d.,]+([eE][-+]?\d+)?", name) is not None for name in header) > len(header):
        what = "has no header: the first line holds numbers"
        raise InputError(Problem(file, line, 0, what, "name the columns in a line above them: A1, A2, …, X, Y, Z"))
    twice = [name for name, count in Counter(header).items() if count > 1]
    if twice:
        names = ", ".join(f"'{name}'" for name in twice)
        raise InputError(Problem(file, line, 0, f"column {names} is there more than once", "remove or rename one"))
