"""Compensation tables as the controller keeps them: staged, active, previous, and remembered between processes."""

from __future__ import annotations

import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, final

from sims.scene.motions import Joints

MOST_ROWS = 500


@final
@dataclass(frozen=True, slots=True)
class Row:
    """One pose twice, degrees: as the nominal model has it, and as the robot is commanded there."""

    nominal: Joints
    compensated: Joints


@final
@dataclass(frozen=True, slots=True)
class Table:
    """A whole table: what is active, or was before. `lines`: the text that its sum is of."""

    id: str
    sum: str
    rows: tuple[Row, ...]
    lines: str


@final
@dataclass(slots=True)
class Staging:
    """A table on its way in: what it is announced to be, and the rows taken so far."""

    id: str
    size: int
    sum: str
    rows: list[Row] = field(default_factory=list)


class TableRefused(Exception):
    """The request to the tables is impossible; nothing has changed. The text gives the reason."""


class BadSum(TableRefused):
    """A sum, or an Id, that does not fit."""


class NoSuchRows(TableRefused):
    """Nothing staged, rows that are not there, or not in order."""


class BadSize(TableRefused):
    """A table without rows, or with too many."""


@final
class Tables:
    """The controller's memory for tables. Until `activate` the active one stays what it was."""

    def __init__(self, active: Table | None = None, previous: Table | None = None) -> None:
        self.active = active
        self.previous = previous
        self.staged: Staging | None = None

    def stage(self, table_id: str, size: int, total: str) -> None:
        """Forget what was staged and begin a table anew, of so many rows and this sum. Raises BadSize."""
        if not 0 < size <= MOST_ROWS:
            raise BadSize(f"a table has 1 … {MOST_ROWS} rows, not {size}")
        self.staged = Staging(table_id, size, total)

    def take(self, first: int, rows: Sequence[Row], total: str) -> None:
        """Take the rows from number `first` on; again, letter for letter, changes nothing. Raises TableRefused."""
        _fits(total, row_lines(first, rows), "the block")
        staged = self._staged()
        taken = len(staged.rows)
        if first == taken + 1 and taken + len(rows) <= staged.size:
            staged.rows.extend(rows)
        elif first < 1 or row_lines(first, staged.rows[first - 1 : first - 1 + len(rows)]) != row_lines(first, rows):
            raise NoSuchRows(f"rows {first} … {first + len(rows) - 1} do not follow the {taken} of {staged.size} taken")

    def read(self, first: int, count: int) -> Sequence[Row]:
        """Rows of the staged table, or of the active one where nothing is staged. Raises NoSuchRows."""
        source = self.staged or self.active
        found = source.rows[first - 1 : first - 1 + count] if source and first >= 1 else ()
        if len(found) != count:
            raise NoSuchRows(f"there are no rows {first} … {first + count - 1}")
        return found

    def activate(self, table_id: str, total: str) -> None:
        """Staged becomes active and active previous, at once; done before, it is done. Raises TableRefused."""
        if self.active and self.active.id == table_id:
            self._confirm(self.active, total)
            return
        staged = self._staged()
        if len(staged.rows) != staged.size:
            raise NoSuchRows(f"only {len(staged.rows)} of {staged.size} rows are there")
        if staged.id != table_id or staged.sum != total:
            raise BadSum(f"staged is table '{staged.id}' with sum {staged.sum}")
        lines = row_lines(1, staged.rows)
        _fits(total, lines, "the table")
        self.active, self.previous, self.staged = Table(staged.id, total, tuple(staged.rows), lines), self.active, None

    def rollback(self) -> None:
        """Active and previous change places. Raises NoSuchRows where there is neither."""
        if not self.active and not self.previous:
            raise NoSuchRows("there is neither an active table nor one before it")
        self.active, self.previous = self.previous, self.active

    def target(self, row: int) -> Joints | None:
        """The compensated joints of the active table's row, from 1, degrees; None where there is no such row."""
        rows = self.active.rows if self.active else ()
        return rows[row - 1].compensated if 1 <= row <= len(rows) else None

    def forget_staged(self) -> None:
        """The controller restarts: what was staged is lost."""
        self.staged = None

    def _staged(self) -> Staging:
        if self.staged is None:
            raise NoSuchRows("nothing is staged")
        return self.staged

    def _confirm(self, active: Table, total: str) -> None:
        """Activated before; the same table staged once more would push the one before it out of memory."""
        if active.sum != total:
            raise BadSum(f"active is table '{active.id}' with sum {active.sum}")
        if self.staged and self.staged.id == active.id:
            self.staged = None


def row_lines(first: int, rows: Sequence[Row]) -> str:
    """The text that sums are of: a line a row, `N;A1;…;A6;A1;…;A6`, six decimals."""
    lines = []
    for number, row in enumerate(rows, first):
        fields = [f"{angle:.6f}" for angle in (*row.nominal, *row.compensated)]
        lines.append(";".join([str(number), *fields]) + "\n")
    return "".join(lines)


def table_sum(text: str) -> str:
    """CRC-32 as eight upper-case hexadecimal digits."""
    return f"{zlib.crc32(text.encode()):08X}"


def _fits(total: str, text: str, what: str) -> None:
    if total != (found := table_sum(text)):
        raise BadSum(f"the sum of {what} is {found}, not {total}")


def state_of_tables(tables: Tables) -> dict[str, Any]:
    """As JSON has it. What is staged is not remembered."""
    return {"active": _told(tables.active), "previous": _told(tables.previous)}


def tables_from(state: Mapping[str, Any], axes: int) -> Tables:
    """The tables of a `state` that was kept. Raises ValueError, TypeError, LookupError, AttributeError."""
    return Tables(_table(state["active"], axes), _table(state["previous"], axes))


def _told(table: Table | None) -> dict[str, str] | None:
    return table and {"id": table.id, "sum": table.sum, "lines": table.lines}


def _table(state: Mapping[str, str] | None, axes: int) -> Table | None:
    if state is None:
        return None
    if table_sum(state["lines"]) != state["sum"]:
        raise ValueError(f"the sum of table '{state['id']}' does not fit")
    rows = tuple(_row(line.split(";")[1:], axes) for line in state["lines"].splitlines())
    return Table(state["id"], state["sum"], rows, state["lines"])


def _row(fields: list[str], axes: int) -> Row:
    angles = tuple(float(field) for field in fields)
    if len(angles) != 2 * axes:
        raise ValueError(f"a row has {len(angles)} angles, not {2 * axes}")
    return Row(angles[:axes], angles[axes:])
