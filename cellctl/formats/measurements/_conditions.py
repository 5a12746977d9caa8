"""Conditions of the robot at each row: temperature, payload, side of approach, motor currents."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from typing import final

import numpy as np

from cellctl.calibration import Postures
from cellctl.formats.dataset import Sieve
from cellctl.formats.measurements.columns import ABC, OF_DISTANCE, OF_ROTATION, QUATERNION, SIGMA_COLUMNS
from cellctl.formats.measurements.kinds import KINDS, Kind
from cellctl.kinematics import Floats
from cellctl.robot_file import RobotFile

REFERENCE_C = 20.0
"""Temperature at which lengths hold (ISO 1)."""

COLDEST_C, HOTTEST_C = -100.0, 1000.0
HEAVIEST_KG = 1e4
"""Beyond any robot's conditions: a typing error, which would dominate all other rows."""

PAYLOAD_AT = ("payload_x", "payload_y", "payload_z")


@final
class Conditions:
    """Readings with the conditions whose columns exist.

    delta_t (N,): °C above 20, a missing one the mean of the others; payload (N,), kg: a missing one 0; payload_at
    (N, 3): its centre of gravity, flange frame, mm; approach (N, n): the model's sense of each joint's last movement, 0
    where it is not known; currents (N, n), A, in the model's sense, NaN where one is missing. None where there is no
    column.
    """

    def __init__(self, sieve: Sieve, robot: RobotFile, readings: Floats) -> None:
        self.q = robot.joint_map().model(readings)
        self.delta_t = _warmer(sieve)
        self.payload = _payload(sieve)
        self.payload_at = None if self.payload is None else _payload_at(sieve, self.payload)
        self.approach = _approach(sieve, robot)
        self.currents = _currents(sieve, robot)

    def at(self, rows: Collection[int]) -> Postures:
        """Postures of the robot at `rows`, with their conditions."""
        chosen = list(rows)
        parts = (self.approach, self.delta_t, self.payload, self.payload_at, self.currents)
        return Postures(self.q[chosen], *(None if part is None else part[chosen] for part in parts))


def _warmer(sieve: Sieve) -> Floats | None:
    if not any(sieve.data.texts("temperature")):
        return None
    degrees = np.array(sieve.numbers("temperature", missing=np.inf))
    for row in np.flatnonzero(np.isfinite(degrees) & ((degrees < COLDEST_C) | (degrees > HOTTEST_C))):
        sieve.reject(int(row), f"temperature is {degrees[row]:g} °C: no robot works at that")
        degrees[row] = np.nan
    noted = np.isfinite(degrees)
    mean = degrees[noted].mean() if noted.any() else REFERENCE_C
    return np.where(noted, degrees, mean) - REFERENCE_C


def _payload(sieve: Sieve) -> Floats | None:
    if not any(sieve.data.texts("payload")):
        return None
    values = sieve.numbers("payload", missing=0.0)
    for row, mass in enumerate(values):
        if mass < 0.0 or mass > HEAVIEST_KG:
            sieve.reject(row, f"payload is {mass:g} kg")
    return np.array(values)


def _payload_at(sieve: Sieve, payload: Floats) -> Floats | None:
    """`payload_x`, `payload_y`, `payload_z`; without a payload, where the others' is on average."""
    if not any(any(sieve.data.texts(name)) for name in PAYLOAD_AT):
        return None
    loaded = np.flatnonzero(payload > 0.0).tolist()
    places = np.array([sieve.numbers(name, rows=loaded) for name in PAYLOAD_AT]).T
    stated = np.isfinite(places).all(axis=1)
    if stated.any():
        places[payload == 0.0] = places[stated].mean(axis=0)
    return places


def _approach(sieve: Sieve, robot: RobotFile) -> Floats | None:
    """`D1…Dn`, as the controller counts, in the model's sense: None where no column is filled."""
    names = [f"D{number}" for number in range(1, robot.n + 1)]
    if not any(any(sieve.data.texts(name)) for name in names):
        return None
    columns = [sieve.numbers(name, missing=0.0) for name in names]
    for name, values in zip(names, columns, strict=True):
        for row, value in enumerate(values):
            if value not in (-1.0, 0.0, 1.0):
                sieve.reject(row, f"{name} is {value:g}: the last movement is 1, -1, or 0 where it is not known")
    return np.array(columns).T * robot.joint_map().sign


def _currents(sieve: Sieve, robot: RobotFile) -> Floats | None:
    """`I1…In`, as the controller counts, in the model's sense; NaN where one is missing. None: no column is filled."""
    names = [f"I{number}" for number in range(1, robot.n + 1)]
    if not any(any(sieve.data.texts(name)) for name in names):
        return None
    return np.array([sieve.numbers(name, missing=np.nan) for name in names]).T * robot.joint_map().sign


_NAMES = ("zero", "session", "time")
_NUMBERS = (
    *ABC, *QUATERNION, "radius", "tip_radius", "drift", *SIGMA_COLUMNS, OF_ROTATION, OF_DISTANCE,
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
