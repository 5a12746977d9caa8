"""The joint correction that makes the identified robot reach the nominal robot's TCP pose, one Newton step a cycle.

f is the controller's kinematics, f* the identified robot: links, joint stiffness under weight and load, waves of gears,
bending, and a field over the joints. Sought is δ with f*(q + δ) = f(q). Each cycle makes one damped step from the last
cycle's δ with the Jacobian of f: δ ← δ + J⁺(q)(f(q) − f*(q + δ)). From δ = 0 three steps leave less than 1 µm; from
one cycle to the next δ changes by some 0.1 mm at 100 deg/s, and one step leaves 3 µm of that at most.

Plain numbers, and numpy for the field alone: after 4 ms of other work on the processor each function of numpy costs
some ten microseconds, whatever its arrays.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from operator import mul
from typing import final

from drivers.kuka_rsi.axes import AXES
from drivers.kuka_rsi.cyclic.model_arrays import unpack
from drivers.kuka_rsi.cyclic.online_effects import FieldShift, JointTurns
from drivers.kuka_rsi.cyclic.poses import Pose, Vector, cross, dot, frames_of, inverted, of_matrix, plus, product, times

_DAMPING_MM = 10.0
"""Of the least squares step: a singular direction is left alone. Elsewhere one step leaves 1 % more at most."""

_LEVER_MM = 500.0
"""A radian of the TCP's orientation counts as so many millimetres in the damping."""

_MOST_RAD = math.radians(5.0)
"""No calibration error is larger: at a singularity the steps end here, and find back."""


@final
class OnlineModel:
    """The corrections of one model. `values`: as `pack` made them. Raises ValueError where it did not.

    `last_rad`: correction of the model angles to begin with. Everything is computed in the nominal robot's base. The
    first model with a field imports numpy (0.2 s): before the session, when no telegram waits.
    """

    def __init__(self, values: Sequence[float], last_rad: Sequence[float] | None = None) -> None:
        arrays = {name: list(part) for name, part in unpack(values).items()}
        self._lower, self._upper = arrays["lower"], arrays["upper"]
        self._fade_deg = max(arrays["fade"][0], 1e-6)
        self._sign, self._offset = arrays["sign"], arrays["offset"]
        self._tool = of_matrix(arrays["tool"])
        self._nominal, true = _poses(arrays["links"]), _poses(arrays["identified"])
        to_base = inverted(of_matrix(arrays["base"]))
        self._true = [product(to_base, true[0]), *true[1:]]
        rows = arrays["identified_base"]
        turn = of_matrix([*rows[:3], 0.0, *rows[3:6], 0.0, *rows[6:], 0.0])
        self._shift_turn = product((*to_base[:9], 0.0, 0.0, 0.0), turn)
        self._turns, self._field = JointTurns(arrays), FieldShift(arrays)
        self._down: Vector = (arrays["down"][0], arrays["down"][1], arrays["down"][2])
        self._bend, self._stretch = arrays["bend"][0], arrays["stretch"]
        self._last = [0.0] * AXES if last_rad is None else list(last_rad)

    @property
    def last_rad(self) -> tuple[float, ...]:
        """The last correction of the model angles, rad: the start of the next step."""
        return tuple(self._last)

    def inside(self, readings: Sequence[float]) -> float:
        """1 within the measured region, falling smoothly to 0 at the fade width outside it. readings: A1…A6, deg."""
        beyond = 0.0
        for low, reading, high in zip(self._lower, readings, self._upper, strict=True):
            beyond = max(beyond, low - reading, reading - high)
        share = max(0.0, 1.0 - beyond / self._fade_deg)
        return share * share * (3.0 - 2.0 * share)

    def correction(self, readings: Sequence[float]) -> tuple[float, ...]:
        """The correction of A1…A6, deg, at the programmed joints `readings`, deg, one step from the last cycle's."""
        rows = zip(self._sign, readings, self._offset, strict=True)
        q = [sign * math.radians(reading) + offset for sign, reading, offset in rows]
        frames = frames_of(self._nominal, q)
        goal = product(frames[-1], self._tool)
        columns = _jacobian(frames, goal)
        rest = _difference(goal, self._pose([a + b for a, b in zip(q, self._last, strict=True)]))
        pull = _solved(columns, rest)
        steps = [sum(a * b for a, b in zip(column, pull, strict=True)) for column in columns]
        self._last = [
            max(-_MOST_RAD, min(_MOST_RAD, last + step)) for last, step in zip(self._last, steps, strict=True)
        ]
        return tuple(sign * math.degrees(last) for sign, last in zip(self._sign, self._last, strict=True))

    def _pose(self, q: Sequence[float]) -> Pose:
        """The identified robot's TCP at model angles q, rad."""
        frames = frames_of(self._nominal, q)
        turned = [a + b for a, b in zip(q, self._turns.at(q, frames), strict=True)]
        end = frames_of(self._true, turned)[-1]
        return (*end[:9], *plus(end[9:], times(self._shift_turn, self._shift(q, frames))))

    def _shift(self, q: Sequence[float], frames: Sequence[Pose]) -> Vector:
        """Shift of the TCP, mm, along the robot's base: bending, expansion, field."""
        shift = self._field.at(q)
        along, bend = frames[-1][6:9], self._bend
        share = dot(self._down, along)
        shift = plus(shift, tuple(bend * (down - share * axis) for down, axis in zip(self._down, along, strict=True)))
        for factor, frame in zip(self._stretch, frames, strict=True):
            if factor:
                shift = plus(shift, tuple(factor * place for place in frame[9:]))
        return shift


def _poses(matrices: Sequence[float]) -> list[Pose]:
    return [of_matrix(matrices[at : at + 16]) for at in range(0, len(matrices), 16)]


def _difference(goal: Pose, actual: Pose) -> list[float]:
    """Shift, mm, and small rotation vector, rad times the lever, from pose `actual` to `goal`."""
    turn: Vector = (0.0, 0.0, 0.0)
    for at in (0, 3, 6):
        turn = plus(turn, cross(actual[at : at + 3], goal[at : at + 3]))
    shift = [a - b for a, b in zip(goal[9:], actual[9:], strict=True)]
    return [*shift, *(0.5 * _LEVER_MM * axis for axis in turn)]


def _jacobian(frames: Sequence[Pose], end: Pose) -> list[list[float]]:
    """Columns of the TCP's motion by each joint: mm, and rad times the lever, per rad."""
    columns = []
    for frame in frames[:AXES]:
        axis = frame[6:9]
        arm = (end[9] - frame[9], end[10] - frame[10], end[11] - frame[11])
        columns.append([*cross(axis, arm), *(_LEVER_MM * each for each in axis)])
    return columns


def _solved(columns: list[list[float]], rest: list[float]) -> list[float]:
    """y of (J Jᵀ + λ²) y = rest, by elimination in the upper triangle of a positive definite matrix."""
    across = list(zip(*columns, strict=True))
    rows = []
    for i, own in enumerate(across):
        row = [sum(map(mul, own, other)) for other in across[i:]]
        row[0] += _DAMPING_MM**2
        rows.append([*row, rest[i]])
    for i, first in enumerate(rows):
        for j in range(1, len(rows) - i):
            factor = first[j] / first[0]
            rows[i + j] = [a - factor * b for a, b in zip(rows[i + j], first[j:], strict=True)]
    found: list[float] = []
    for row in reversed(rows):
        found.insert(0, (row[-1] - sum(map(mul, row[1:-1], found))) / row[0])
    return found
