"""Rows of a study as Parquet: a column for each name, in the order of the units."""

from __future__ import annotations

import io
from collections.abc import Sequence

from cellctl.files import InputError, Problem
from cellctl.installed import has_package
from cellctl.operations.studies.runner import Row

CURE = "install it with `pip install 'cellctl[study]'`"


def refuse_without_parquet() -> None:
    """Raise InputError where pyarrow is missing."""
    if not has_package("pyarrow"):
        what = "the rows of a study are written as Parquet, and the package pyarrow is missing"
        raise InputError(Problem("cellctl study", 0, 0, what, CURE))


def parquet_of(rows: Sequence[Row]) -> bytes:
    """The rows as Parquet: the same rows give the same bytes. A column with numbers and text is text."""
    import pyarrow as pa  # an extra: it may be missing
    from pyarrow import parquet  # an extra: it may be missing

    columns = {}
    for name in dict.fromkeys(name for row in rows for name in row):
        values = [row.get(name) for row in rows]
        kinds = {type(value) for value in values if value is not None}
        if kinds == {int, float}:
            values = [None if value is None else float(value) for value in values]
        elif len(kinds) > 1:
            values = [None if value is None else str(value) for value in values]
        columns[name] = pa.array(values)
    stream = io.BytesIO()
    parquet.write_table(pa.table(columns), stream)
    return stream.getvalue()
