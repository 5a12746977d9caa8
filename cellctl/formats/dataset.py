"""Data sets: CSV with a header, and its columns as numbers, row by row usable or rejected with the reason."""

from __future__ import annotations

import csv
import io
import math
import re
from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self, TypeAlias, final

import numpy as np

from cellctl.files import InputError, Problem, sha256_of, write_atomically
from cellctl.files.kinds import DATA_SET, kind_of, read_bytes, refuse_other_kind
from cellctl.formats.spreadsheet_text import decoded, named, separator, with_points
from cellctl.kinematics import Bools, Floats
from cellctl.robot_file import RobotFile

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
        data = read_bytes(path, DATA_SET)
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


BEYOND_LIMITS_DEG = 5.0
"""A joint reading further than this outside the robot file's limits cannot be this robot's."""

BEYOND_TRAVEL_MM = 50.0
"""The same for a prismatic joint."""

BEYOND = 5e5
"""No number of a data set is larger: 500 m, where all lengths are mm. A larger one would dominate all other rows."""

_MOST_JOINTS = 20

MOST_RADIANS = 6.6
"""Readings beyond this, in most rows, are probably not radians: more than a turn."""


@final
class Sieve:
    """The rows of a data set that are still usable; each rejected one keeps its first reason."""

    def __init__(self, data: DataSet) -> None:
        self.data = data
        self._reasons: dict[int, str] = {}

    def reject(self, row: int, reason: str) -> None:
        """Row `row` (from 0) cannot be used."""
        self._reasons.setdefault(row, reason)

    def numbers(self, name: str, *, missing: float | None = None, rows: Collection[int] | None = None) -> list[float]:
        """A column's numbers (N,); rejected are rows with none (unless `missing` replaces it), text, NaN, infinity or a
        number that is too large.

        rows: only these are read; NaN for the others.
        """
        return [
            self._number(row, name, cell, missing) if rows is None or row in rows else math.nan
            for row, cell in enumerate(self.data.values(name))
        ]

    def kept(self) -> list[int]:
        """The usable rows (from 0), in order. Raises InputError where there is none, with the reasons."""
        kept = [row for row in range(len(self.data)) if row not in self._reasons]
        if kept:
            return kept
        some = [Problem(self.data.file, reject.line, 0, reject.reason) for reject in self.rejected()[:10]]
        raise InputError([Problem(self.data.file, 0, 0, "holds no row that can be used"), *some])

    def rejected(self) -> list[Rejected]:
        """All rejected rows, those of the file's own reading included, by line."""
        mine = [Rejected(self.data.lines[row], reason) for row, reason in self._reasons.items()]
        return sorted([*self.data.rejected, *mine], key=lambda rejected: rejected.line)

    def _number(self, row: int, name: str, cell: Cell, missing: float | None) -> float:
        text = str(cell)
        if not text:
            if missing is None:
                self.reject(row, f"{name} is missing")
            return math.nan if missing is None else missing
        try:
            value = float(cell if "_" not in text else "text")  # 1_000 is Python's own way to write a number
        except ValueError:
            self.reject(row, f"{name} '{text[:20]}' is not a number")
            return math.nan
        if not math.isfinite(value):
            self.reject(row, f"{name} is {text}")
        elif abs(value) > BEYOND:
            self.reject(row, f"{name} is {text[:20]}: no robot is measured by numbers beyond {BEYOND:.0f}")
            return math.nan
        return value


def joint_readings(sieve: Sieve, robot: RobotFile) -> Floats:
    """Controller readings (N, n), deg, from `A1…An` (deg) or `q1…qn` (rad); NaN in rejected rows. Of a prismatic joint
    mm, from mm or m.

    Raises InputError where neither kind is complete, or both are there, or `q1…qn` hold degrees or mm.
    """
    degrees, radians = ([f"{letter}{number}" for number in range(1, robot.n + 1)] for letter in "Aq")
    names = _one_kind(sieve.data, degrees, radians)
    readings = np.array([sieve.numbers(name) for name in names]).T
    if names is radians:
        _refuse_degrees(sieve, robot, readings, names)
        _refuse_mm(sieve, robot, readings, names)
        readings = robot.joint_map().in_reading_units(readings)
    for row, joint in np.argwhere(_beyond_limits(robot, readings)):
        limits, unit = robot.joints[joint], robot.joints[joint].unit.replace("mm", " mm")
        what = f"{names[joint]} is {readings[row, joint]:.6g}{unit}, outside {limits.min:g}…{limits.max:g}{unit}"
        sieve.reject(int(row), what)
    return readings


def joints_of(data: DataSet) -> tuple[int, str]:
    """Number and unit of the joints that a data set names: A1, A2, … (deg) or q1, q2, … (rad); (0, "") for none."""
    for letter, unit in (("A", "deg"), ("q", "rad")):
        names = (f"{letter}{number}" for number in range(1, _MOST_JOINTS + 1))
        count = next((number for number, name in enumerate(names) if not data.has(name)), _MOST_JOINTS)
        if count:
            return count, unit
    return 0, ""


def _beyond_limits(robot: RobotFile, degrees: Floats) -> Bools:
    """Which readings (N, n) this robot cannot have; NaN counts as possible."""
    limits = robot.limits()
    beyond = np.array([BEYOND_TRAVEL_MM if joint.prismatic else BEYOND_LIMITS_DEG for joint in robot.joints])
    return np.asarray(np.maximum(degrees - limits[:, 1], limits[:, 0] - degrees) > beyond)


def _refuse_degrees(sieve: Sieve, robot: RobotFile, given: Floats, names: Sequence[str]) -> None:
    """Raise InputError where most rows (N, n) cannot be this robot's radians, and nearly all of these can be its
    degrees.
    """
    read = np.isfinite(given).all(axis=1)
    revolute = np.array([not joint.prismatic for joint in robot.joints])
    beyond = read & (_beyond_limits(robot, np.rad2deg(given)) & revolute).any(axis=1)
    turns = beyond & (np.abs(given[:, revolute]) > MOST_RADIANS).any(axis=1)
    degrees = turns & ~(_beyond_limits(robot, given) & revolute).any(axis=1)
    wrong, right = int(np.count_nonzero(beyond)), int(np.count_nonzero(degrees))
    if 2 * wrong > np.count_nonzero(read) and right >= 0.9 * wrong:
        rows = f"{wrong} of {len(given)} rows are outside the joints' limits as radians"
        what = f"{names[0]}…{names[-1]} are degrees: {rows}, {right} of these inside as degrees"
        cure = f"name the columns A1…A{len(names)}, which are in degrees, or write radians"
        raise InputError(Problem(sieve.data.file, 1, 0, what, cure))


def _refuse_mm(sieve: Sieve, robot: RobotFile, given: Floats, names: Sequence[str]) -> None:
    """Raise InputError for a prismatic joint whose column (of given (N, n)) can be mm and in most rows cannot be m."""
    as_metres = _beyond_limits(robot, robot.joint_map().in_reading_units(given))
    as_mm = _beyond_limits(robot, given)
    for number in robot.prismatic:
        read = np.isfinite(given[:, number - 1])
        wrong = read & as_metres[:, number - 1]
        if 2 * np.count_nonzero(wrong) > np.count_nonzero(read) and not as_mm[wrong, number - 1].any():
            what = (
                f"{names[number - 1]} is mm: {np.count_nonzero(wrong)} of {len(given)} rows are beyond the travel as m"
            )
            cure = (
                f"write m in {names[number - 1]}, or name the columns A1…A{len(names)}, where a prismatic joint is mm"
            )
            raise InputError(Problem(sieve.data.file, 1, 0, what, cure))


def _one_kind(data: DataSet, degrees: Sequence[str], radians: Sequence[str]) -> Sequence[str]:
    found = [names for names in (degrees, radians) if data.has(*names)]
    if len(found) == 1:
        return found[0]
    if found:
        what = f"has both {degrees[0]}… (degrees) and {radians[0]}… (radians)"
        raise InputError(Problem(data.file, 1, 0, what, "keep one kind"))
    what = (
        f"has no complete set of joint readings: {degrees[0]}…{degrees[-1]} (deg) or {radians[0]}…{radians[-1]} (rad)"
    )
    lacking = [name for name in degrees if not data.has(name)]
    cure = f"missing: {', '.join(lacking)}" if len(lacking) < len(degrees) else f"columns here: {_some(data.columns)}"
    raise InputError(Problem(data.file, 1, 0, what, cure))


def _some(names: Sequence[str]) -> str:
    return ", ".join(names[:12]) + (", …" if len(names) > 12 else "")
