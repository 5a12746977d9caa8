"""Arrays of the user as arrays of numbers. Each refusal names the argument, the row and the cure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cellctl.files import InputError, Problem

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from cellctl.kinematics import Floats

RIGID = 1e-6
"""A rotation matrix may deviate from an orthonormal one by this much: rounding of printed digits."""


def numbers(values: ArrayLike, name: str) -> Floats:
    """`values` as a new array of floats, any shape. Raises InputError for text, complex numbers and ragged lists."""
    import numpy as np

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
    import numpy as np

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
    import numpy as np

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
    import numpy as np

    found = np.argwhere(~np.isfinite(rows)).tolist()
    if found:
        cure = "a number in degrees; leave out rows that were not measured"
        raise InputError(
            Problem(f"{name}[{row}]", 0, 0, f"{columns[at]} is {rows[row, at]}", cure) for row, at in found
        )
