"""Rows without new information: copies, the only row of a point, repeats; and whether the rows differ enough."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from cellctl.files import InputError, Problem
from cellctl.formats.dataset import Sieve
from cellctl.formats.measurements._conditions import PAYLOAD_AT
from cellctl.formats.measurements.kinds import ABC, OF_DISTANCE, OF_ROTATION, PLACE, QUATERNION, SIGMAS, Kind
from cellctl.kinematics import Floats

if TYPE_CHECKING:
    from cellctl.formats.measurements._measured import Measurements

POINT_COLUMNS: dict[Kind, str] = {"sphere": "sphere", "plane": "plane", "socket": "socket", "distance": "anchor"}
"""The column that names a row's point, for each kind that has one."""

_NAMES = ("sphere", "plane", "socket", "anchor", "zero", "session", "time")
_NUMBERS = (
    *PLACE, *ABC, *QUATERNION, "radius", "tip_radius", "drift", "distance", *SIGMAS, OF_ROTATION, OF_DISTANCE,
    "temperature", "payload", *PAYLOAD_AT,
)  # fmt: skip

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
        sieve.reject(row, f"the only row of {POINT_COLUMNS[kinds[row]]} '{name}'{where}: mistyped?")


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
    return _POINT_NUMBERS if kind == "socket" else 1


def _cells(sieve: Sieve, readings: Floats) -> Floats:
    """The rows' readings and all other cells in use (N, K) as numbers: 2.50 is 2.5, a name is a number for each."""
    data = sieve.data
    numbers = [*_NUMBERS, *(f"D{number + 1}" for number in range(readings.shape[1]))]
    columns = [list(map(_number, data.texts(name))) for name in numbers if data.has(name)]
    columns += [_numbered(data.texts(name)) for name in _NAMES if data.has(name)]
    return np.column_stack([readings, *columns]) + 0.0  # -0.0 is 0.0


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan


def _numbered(names: Sequence[str]) -> list[float]:
    numbers: dict[str, float] = {}
    return [numbers.setdefault(name, float(len(numbers))) for name in names]


SCATTERED = 5.0
"""Places within this many of their σ of one place are that place."""

_NAMED = 10


def refuse_alike(measured: Measurements) -> None:
    """Raise InputError with fewer different rows than registration needs, or with only one place from an instrument."""
    rows, least = len(measured.lines), measured.task.rows_at_least
    different = len(set(measured.sightings()))
    if different < least:
        repeated = f", but {different} different: the others repeat their postures" if different < rows else ""
        what = f"too few rows to fit where even the registration takes {least}: {rows}{repeated}"
        problem = Problem(measured.data.file, 0, 0, what, "measure in other postures")
        some = [Problem(problem.file, row.line, 0, row.reason) for row in measured.rejected[:_NAMED]]
        raise InputError([problem, *some])
    _refuse_one_place(measured)


def _refuse_one_place(measured: Measurements) -> None:
    """Refuse an instrument's rows with one TCP place at all joints: they cannot register the robot."""
    task = measured.task
    if "base" not in task.registered:
        return
    for number, session in enumerate(task.sessions):
        blocks = [block for block in task.rows.blocks if block.session == number and len(block)]
        mine = [(block, places) for block in blocks if (places := block.positions) is not None]
        if not mine:
            continue
        xyz = np.concatenate([places for _, places in mine])
        sigma = np.concatenate([block.sigma[:, :3] for block, _ in mine])
        if len(xyz) > 1 and np.all(np.abs(xyz - np.median(xyz, axis=0)) <= SCATTERED * sigma):
            where = f" of session '{session.name}'" if session.name else ""
            what = f"X, Y, Z{where} are the same place in all {len(xyz)} rows, though the joints differ"
            cure = "measure the tool at other places; a tool held in one place is a socket (column socket)"
            raise InputError(Problem(measured.data.file, 1, 0, what, cure))
