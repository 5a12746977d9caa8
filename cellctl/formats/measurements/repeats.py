"""Rows without new information: copies, the only row of a point, repeats; and whether the rows differ enough."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np

from cellctl.formats.dataset import Sieve
from cellctl.formats.measurements._conditions import PAYLOAD_AT
from cellctl.formats.measurements.columns import ABC, OF_DISTANCE, OF_ROTATION, QUATERNION, SIGMAS
from cellctl.formats.measurements.kinds import KINDS, Kind
from cellctl.kinematics import Floats

_NAMES = ("zero", "session", "time")
_NUMBERS = (
    *ABC, *QUATERNION, "radius", "tip_radius", "drift", *SIGMAS, OF_ROTATION, OF_DISTANCE,
    "temperature", "payload", *PAYLOAD_AT,
)  # fmt: skip
"""Columns of the cells that make two rows different, besides those of the row kinds."""

_POINT_NUMBERS = 3


def reject_copies(sieve: Sieve, readings: Floats, kept: Sequence[int]) -> None:
    """Reject those of the rows `kept` that equal an earlier one number by number: in readings (N, n), measurement and
    conditions, regardless of their `set`. Real repeats differ in the last digit, or in their `time`.
    """
    cells = _cells(sieve, readings)
    first: dict[bytes, int] = {}
    for row in kept:
        earlier = first.setdefault(cells[row].tobytes(), row)
        if earlier != row:
            sieve.reject(row, f"the same as line {sieve.data.lines[earlier]}, number by number: no second measurement")


def reject_lone(
    sieve: Sieve, points: Sequence[tuple[str, str]], kinds: Sequence[Kind], spacings: Mapping[str, int], kept: list[int]
) -> None:
    """Reject those of the rows `kept` that are the only one of their point, where others are left.

    points (N): name and session of each row's point, "" where it does not matter; spacings: count of known distances
    from the points of a name. Three numbers find a point; only further ones give information on the robot.
    """
    rows_of = Counter(points[row] for row in kept)
    lone = [row for row in kept if points[row][0] and rows_of[points[row]] == 1]
    lone = [row for row in lone if _numbers(kinds[row]) + spacings.get(points[row][0], 0) <= _POINT_NUMBERS]
    if len(lone) == len(kept):
        return  # another error reports too few rows
    for row in lone:
        name, session = points[row]
        where = f" in session '{session}'" if session else ""
        sieve.reject(row, f"the only row of {KINDS[kinds[row]].point} '{name}'{where}: mistyped?")


def reject_lone_zeros(sieve: Sieve, zeros: Sequence[str], kept: list[int]) -> None:
    """Reject those of the rows `kept` that are the only ones of an unknown zero, where others are left: one length only
    finds its zero. zeros (N): its name in each row, "" where there is none.
    """
    rows_of = Counter(zeros[row] for row in kept)
    lone = [row for row in kept if zeros[row] and rows_of[zeros[row]] == 1]
    if len(lone) == len(kept):
        return  # another error reports too few rows
    for row in lone:
        sieve.reject(
            row, f"one length only with zero '{zeros[row]}': it cannot be distinguished from the zero; mistyped?"
        )


def posture_numbers(readings: Floats) -> list[int]:
    """A number for each different row of `readings` (N, n), in order of appearance."""
    numbers: dict[bytes, int] = {}
    return [numbers.setdefault(posture.tobytes(), len(numbers)) for posture in readings + 0.0]  # -0.0 is 0.0


def _numbers(kind: Kind) -> int:
    """Count of numbers that a row of this kind gives for its point."""
    return _POINT_NUMBERS if KINDS[kind].rows.at_point else 1


def _cells(sieve: Sieve, readings: Floats) -> Floats:
    """The rows' readings and all other cells in use (N, K) as numbers: 2.50 is 2.5, a name is a number for each."""
    data = sieve.data
    points = [kind.point for kind in KINDS.values() if kind.point]
    measured = {column for kind in KINDS.values() for column in kind.columns}.difference(points)
    numbers = [*_NUMBERS, *sorted(measured), *(f"D{number + 1}" for number in range(readings.shape[1]))]
    columns = [list(map(_number, data.texts(name))) for name in numbers if data.has(name)]
    columns += [_numbered(data.texts(name)) for name in (*_NAMES, *dict.fromkeys(points)) if data.has(name)]
    return np.column_stack([readings, *columns]) + 0.0  # -0.0 is 0.0


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan


def _numbered(names: Sequence[str]) -> list[float]:
    numbers: dict[str, float] = {}
    return [numbers.setdefault(name, float(len(numbers))) for name in names]
