"""Arrays and columns of the user (DataFrame, mapping) as numbers and data sets; results as a DataFrame.

pandas is optional: it is imported only where a DataFrame is asked for.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cellctl.files import InputError, Problem, sha256_of
from cellctl.formats import DataSet
from cellctl.kinematics import Floats

RIGID = 1e-6
"""A rotation matrix may deviate from an orthonormal one by this much: rounding of printed digits."""


def numbers(values: ArrayLike, name: str) -> Floats:
    """`values` as a new array of floats, any shape. Raises InputError for text, complex numbers and ragged lists."""
    try:
        array = np.array(values)
        if array.dtype.kind == "c":
            raise TypeError
        return array.astype(float)
    except (TypeError, ValueError) as error:
        raise refused(name, "is no array of numbers", "lists or arrays of numbers, rows of equal length") from error


def postures(values: ArrayLike, n: int, name: str = "q") -> Floats:
    """Controller readings (N, n), deg; one posture (n,) becomes one row. Raises InputError with every row that is not
    finite.
    """
    array = numbers(values, name)
    rows = array[None] if array.ndim == 1 and array.size else array
    if rows.ndim != 2 or rows.shape[1] != n or not len(rows):
        cure = f"one row for each posture, A1…A{n} in degrees: (N, {n})"
        turned = array.ndim == 2 and array.shape[0] == n
        raise refused(name, f"has the shape {array.shape}, and the robot has {n} joints", cure + turned * "; transpose")
    _refuse_infinite(rows, name, [f"A{joint}" for joint in range(1, n + 1)])
    return np.asarray(rows)


def poses(values: ArrayLike, name: str) -> Floats:
    """Poses (N, 4, 4), mm; one pose (4, 4) becomes one row. Raises InputError with every row that is no rigid
    motion.
    """
    array = numbers(values, name)
    rows = array[None] if array.shape == (4, 4) else array
    if rows.ndim != 3 or rows.shape[1:] != (4, 4) or not len(rows):
        cure = "homogeneous matrices in mm, (N, 4, 4); or a DataFrame or mapping with X, Y, Z and A, B, C"
        raise refused(name, f"has the shape {array.shape}", cure)
    turns, last = rows[:, :3, :3], rows[:, 3]
    with np.errstate(invalid="ignore"):
        off = np.abs(np.swapaxes(turns, 1, 2) @ turns - np.eye(3)).max(axis=(1, 2))
        rigid = (off < RIGID) & (np.linalg.det(turns) > 0.0) & (np.abs(last - [0, 0, 0, 1]).max(axis=1) < RIGID)
    bad = np.flatnonzero(~(rigid & np.isfinite(rows).all(axis=(1, 2))))
    if len(bad):
        cure = "a rotation matrix, a translation in mm, and the last row 0, 0, 0, 1"
        raise InputError(Problem(f"{name}[{row}]", 0, 0, "is no rigid motion", cure) for row in bad.tolist())
    return rows


def refused(name: str, what: str, cure: str) -> InputError:
    """The error of the argument `name`."""
    return InputError(Problem(name, 0, 0, what, cure))


def _refuse_infinite(rows: Floats, name: str, columns: list[str]) -> None:
    found = np.argwhere(~np.isfinite(rows)).tolist()
    if found:
        cure = "a number in degrees; leave out rows that were not measured"
        raise InputError(
            Problem(f"{name}[{row}]", 0, 0, f"{columns[at]} is {rows[row, at]}", cure) for row, at in found
        )


Columns = Mapping[str, "NDArray[Any]"]


def is_frame(source: object) -> bool:
    """Whether `source` is a pandas DataFrame."""
    return any(
        each.__module__.split(".")[0] == "pandas" and each.__name__ == "DataFrame" for each in type(source).mro()
    )


def data_set_of(source: Any, name: str) -> DataSet:
    """A data set from a DataFrame or a mapping of arrays (N,); `name` names it in errors. NaN, None and pandas' NA are
    missing values, as in the CSV that pandas writes.

    Raises InputError for columns of unequal length, of more than one dimension, or of the same name.
    """
    columns = _of_frame(source, name) if is_frame(source) else _of_mapping(source, name)
    lengths = {key: len(values) for key, values in columns.items()}
    if len(set(lengths.values())) > 1:
        some = ", ".join(f"{key}: {count}" for key, count in list(lengths.items())[:12])
        raise refused(name, f"has columns of different length ({some})", "one value for each row in every column")
    records = [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
    found = DataSet.of_records(records, name)
    return replace(found, sha256=sha256_of(found.text()))


def by_index(error: InputError) -> InputError:
    """The same error, with rows of a data set from memory named by index: `q[3]` in place of line 5 of its CSV."""
    return InputError(
        replace(each, file=f"{each.file}[{each.line - 2}]" if each.line > 1 else each.file, line=0)
        for each in error.problems
    )


def frame_of(columns: Columns) -> Any:
    """A DataFrame of `columns`. Raises ImportError with the cure where pandas is not installed."""
    try:
        import pandas  # an extra: it may be missing
    except ImportError as error:
        words = "a DataFrame needs pandas: pip install 'cellctl[dataframes]'; to_dict() gives the same as arrays"
        raise ImportError(words) from error
    return pandas.DataFrame(dict(columns))


def columns_of(records: Iterable[Mapping[str, Any]]) -> dict[str, NDArray[Any]]:
    """Columns (N,) of `records` that all have the same keys; None becomes NaN."""
    rows = list(records)
    return (
        {key: np.array([np.nan if row[key] is None else row[key] for row in rows]) for key in rows[0]} if rows else {}
    )


def _of_frame(frame: Any, name: str) -> dict[str, list[Any]]:
    names = [str(column) for column in frame.columns]
    twice = sorted({each for each in names if names.count(each) > 1})
    if twice:
        raise refused(name, f"has the column {', '.join(twice)} more than once", "remove or rename one")
    missing = frame.isna()
    return {
        key: [
            None if gone else _plain(value)
            for value, gone in zip(frame[own].tolist(), missing[own].tolist(), strict=True)
        ]
        for key, own in zip(names, frame.columns, strict=True)
    }


def _of_mapping(columns: Mapping[str, Any], name: str) -> dict[str, list[Any]]:
    found = {}
    for key, values in columns.items():
        array = np.asarray(values)
        if array.ndim != 1:
            cure = "one array (N,) for each column, such as A1, A2, …, X, Y, Z"
            raise refused(name, f"column '{key}' has the shape {array.shape}", cure)
        found[str(key)] = [_plain(value) for value in array.tolist()]
    return found


def _plain(value: Any) -> Any:
    """A cell: NaN is a missing value; text without the spaces around it, as in a file."""
    if isinstance(value, str):
        return value.strip()
    return None if isinstance(value, float) and value != value else value
