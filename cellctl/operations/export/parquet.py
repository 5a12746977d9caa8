"""The samples as a Parquet file, by the optional package pyarrow."""

from __future__ import annotations

import io
from importlib.util import find_spec

from cellctl.files import InputError, Problem
from cellctl.operations.export.samples import Samples

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
    import pyarrow as pa
    from pyarrow import parquet as files

    types = {"integer": pa.int64(), "number": pa.float64(), "string": pa.string(), "boolean": pa.bool_()}
    fields = [
        pa.field(column.name, types[column.kind], metadata={"unit": column.unit} if column.unit else None)
        for column in samples.columns
    ]
    arrays = [pa.array(column.values, field.type) for column, field in zip(samples.columns, fields, strict=True)]
    stream = io.BytesIO()
    files.write_table(pa.Table.from_arrays(arrays, schema=pa.schema(fields, metadata={"run": run})), stream)
    return stream.getvalue()
