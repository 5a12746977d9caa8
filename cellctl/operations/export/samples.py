"""The samples of a run as one table: columns with units, a row for each measured row; also as a Parquet file."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any, Literal, Self, final

from cellctl.files import InputError, Problem
from cellctl.journal import RecordedRow, RunState

_JOINTS = ("joints", "resting", "commanded", "nominal", "at_target", "at_contact", "readings")
_PER_JOINT = (*_JOINTS, "direction", "amperes", "sigma_a")
"""Lists with an item for each joint: their columns end in A1 … An."""

_COORDINATES = ("xyz", "normal", "target", "covariance", "common")
"""Lists with an item for each of x, y, z."""

_UNITS = {
    **dict.fromkeys(_JOINTS, "deg"),
    **dict.fromkeys(("xyz", "target", "scatter"), "mm"),
    **dict.fromkeys(("covariance", "common"), "mm^2"),
    **dict.fromkeys(("amperes", "sigma_a"), "A"),
}
_SUFFIXES = {
    "mm": "mm", "deg": "deg", "rad": "rad", "ns": "ns", "ms": "ms", "s": "s", "c": "degC", "hpa": "hPa", "percent": "%",
}  # fmt: skip


@final
@dataclass(frozen=True, slots=True)
class Leaf:
    """A value of a row: the name of its column, its unit ("" if it has none), and the value."""

    name: str
    unit: str
    value: Any


def leaves(data: Mapping[str, Any]) -> Iterator[Leaf]:
    """The values of a journal row: `{"point": {"xyz": [1, 2, 3]}}` has `point_xyz_x`, `point_xyz_y`, `point_xyz_z`.

    Items of other lists are counted from 1.
    """
    for key, value in data.items():
        yield from _below(key, key, value)


def unit_of(field: str) -> str:
    """The unit of a field by its name, or by its ending (`shift_mm`); "" if it has none."""
    return _UNITS.get(field) or _SUFFIXES.get(field.rpartition("_")[2] if "_" in field else "", "")


def _below(name: str, field: str, value: Any) -> Iterator[Leaf]:
    match value:
        case dict():
            for key, inner in value.items():
                yield from _below(f"{name}_{key}", key, inner)
        case list() | tuple():
            for index, inner in enumerate(value):
                yield from _below(f"{name}_{_label(field, index)}", field, inner)
        case _:
            yield Leaf(name, unit_of(field), value)


def _label(field: str, index: int) -> str:
    if field in _PER_JOINT:
        return f"A{index + 1}"
    return "xyz"[index] if field in _COORDINATES and index < 3 else str(index + 1)


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


CURE = "install it with `pip install 'cellctl[parquet]'`, or export --as csv: it has the same columns"


def installed() -> bool:
    """Whether Parquet can be written here."""
    return find_spec("pyarrow") is not None


def parquet(samples: Samples, run: str) -> bytes:
    """The samples of `run` (its name) as Parquet: a column's unit is in the metadata of its field, key `unit`.

    Raises InputError without pyarrow.
    """
    if not installed():
        raise InputError(Problem("--as parquet", 0, 0, "Parquet needs the package pyarrow, which is missing", CURE))
    import pyarrow as pa  # an extra: it may be missing
    from pyarrow import parquet as files  # an extra: it may be missing

    types = {"integer": pa.int64(), "number": pa.float64(), "string": pa.string(), "boolean": pa.bool_()}
    fields = [
        pa.field(column.name, types[column.kind], metadata={"unit": column.unit} if column.unit else None)
        for column in samples.columns
    ]
    arrays = [pa.array(column.values, field.type) for column, field in zip(samples.columns, fields, strict=True)]
    stream = io.BytesIO()
    files.write_table(pa.Table.from_arrays(arrays, schema=pa.schema(fields, metadata={"run": run})), stream)
    return stream.getvalue()
