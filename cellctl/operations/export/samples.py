"""The samples of a run as one table: every measured row of the journal, a column for each of its values."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Literal, Self, final

from cellctl.journal import RecordedRow, RunState
from cellctl.operations.export.columns import Leaf, leaves

Kind = Literal["integer", "number", "string", "boolean"]
"""The type of a column, in the words of JSON schema."""


@final
@dataclass(frozen=True, slots=True)
class Column:
    """A column: its name, unit ("" if it has none), type, and a value for each row, None where the row has none."""

    name: str
    unit: str
    kind: Kind
    values: tuple[Any, ...]


@final
@dataclass(frozen=True, slots=True)
class Samples:
    """N samples in the order of recording.

    columns: `seq` (number of the event in the journal), `time_s` (the cell's time), `kind` of the row, `step`,
    `attempt`, `counts` (false: of a failed or repeated attempt), then the row's own values.
    """

    columns: tuple[Column, ...]
    count: int

    @classmethod
    def of(cls, rows: Iterable[RecordedRow], state: RunState) -> Self:
        """The samples among `rows`; `state`: of the whole run, says which of them count."""
        found = [_leaves(row, state) for row in rows if is_sample(row)]
        units = {leaf.name: leaf.unit for leaf in (*_OWN, *(leaf for row in found for leaf in row))}
        values = [{leaf.name: leaf.value for leaf in row} for row in found]
        columns = [_column(name, unit, tuple(row.get(name) for row in values)) for name, unit in units.items()]
        return cls(tuple(columns), len(found))

    def rows(self) -> list[tuple[Any, ...]]:
        """The samples, row by row."""
        return list(zip(*(column.values for column in self.columns), strict=True))

    def to_csv(self) -> str:
        """CSV with a header row: `.` decimals, all digits, `true` and `false`, empty cells for missing values."""
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow([column.name for column in self.columns])
        writer.writerows([[_cell(value) for value in row] for row in self.rows()])
        return text.getvalue()


def is_sample(row: RecordedRow) -> bool:
    """Whether a row was measured: the campaign counts it, or it has the readings of joints or a point."""
    data = row.event.data
    readings = (data.get("joints"), data.get("commanded"))
    return row.measurement or isinstance(data.get("point"), dict) or any(map(_are_readings, readings))


def _are_readings(value: Any) -> bool:
    return isinstance(value, list | tuple) and all(isinstance(each, int | float) for each in value)


_OWN = (
    Leaf("seq", "", 0),
    Leaf("time_s", "s", 0.0),
    Leaf("kind", "", ""),
    Leaf("step", "", ""),
    Leaf("attempt", "", 0),
    Leaf("counts", "", True),
)


def _leaves(row: RecordedRow, state: RunState) -> list[Leaf]:
    event = row.event
    own = (row.seq, row.time_ns / 1e9, event.row_kind, event.step, event.attempt, state.counts(row))
    taken = {leaf.name for leaf in _OWN}
    of_row = [leaf for leaf in leaves(event.data) if leaf.name not in taken]
    return [*(Leaf(leaf.name, leaf.unit, value) for leaf, value in zip(_OWN, own, strict=True)), *of_row]


def _column(name: str, unit: str, values: tuple[Any, ...]) -> Column:
    empty = {leaf.name: leaf.value for leaf in _OWN}.get(name, 0.0 if unit else "")
    found = {type(value) for value in values if value is not None} or {type(empty)}
    if found == {bool}:
        return Column(name, unit, "boolean", values)
    if found == {int}:
        return Column(name, unit, "integer", values)
    if found <= {int, float}:
        return Column(name, unit, "number", _floats(values))
    return Column(name, unit, "string", tuple(None if value is None else _cell(value) for value in values))


def _floats(values: tuple[Any, ...]) -> tuple[float | None, ...]:
    return tuple(None if value is None else float(value) for value in values)


def _cell(value: Any) -> str:
    if value is None:
        return ""
    return str(value).lower() if isinstance(value, bool) else str(value)
