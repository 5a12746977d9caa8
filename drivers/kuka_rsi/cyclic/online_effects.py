"""The effects of a correction model besides its links: turns of the joints, and the shift of the TCP by a field."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from typing import final

from drivers.kuka_rsi.axes import AXES
from drivers.kuka_rsi.cyclic.poses import Pose, Vector, cross, dot, plus, times

_STILL: Vector = (0.0, 0.0, 0.0)


@final
class JointTurns:
    """What the joints turn by, rad: weight and load on their springs, and the waves of their gears."""

    def __init__(self, arrays: Mapping[str, list[float]]) -> None:
        down, weight = arrays["down"], arrays["weight"]
        self._down: Vector = (down[0], down[1], down[2])
        pairs = [
            [(k, weight[2 * k * AXES + j], weight[(2 * k + 1) * AXES + j]) for k in range(AXES)] for j in range(AXES)
        ]
        self._pulls = [[(k, x, y) for k, x, y in pair if x or y] for pair in pairs]
        self._load, self._load_place = arrays["load"], tuple(arrays["load_place"])
        self._loaded = any(self._load)
        self._waves = [_horner(arrays, joint) for joint in range(AXES)]

    def at(self, q: Sequence[float], frames: Sequence[Pose]) -> list[float]:
        """At model angles q, rad, the nominal robot's frames being `frames`."""
        place = plus(times(frames[-1], self._load_place), frames[-1][9:]) if self._loaded else _STILL
        return [self._by_weight(j, frames, place) + self._by_waves(j, q[j]) for j in range(AXES)]

    def _by_weight(self, joint: int, frames: Sequence[Pose], place: Vector) -> float:
        frame = frames[joint]
        arm = cross(self._down, frame[6:9])
        u = v = w = 0.0
        for k, x, y in self._pulls[joint]:
            x0, x1, x2, y0, y1, y2 = frames[k][:6]
            u += x * x0 + y * y0
            v += x * x1 + y * y1
            w += x * x2 + y * y2
        turn = arm[0] * u + arm[1] * v + arm[2] * w
        if not self._loaded:
            return turn
        lever = (place[0] - frame[9], place[1] - frame[10], place[2] - frame[11])
        return turn + self._load[joint] * dot(arm, lever)

    def _by_waves(self, joint: int, angle: float) -> float:
        """Σ s sin mq + c (cos mq − 1): the real part of Σ (c − is) zᵐ with z = e^iq, by Horner's rule."""
        factors, constant = self._waves[joint]
        total, z = 0j, complex(math.cos(angle), math.sin(angle))
        for factor in factors:
            total = (total + factor) * z
        return total.real - constant


def _horner(arrays: Mapping[str, list[float]], joint: int) -> tuple[list[complex], float]:
    """c − is of each order from the highest to 1, and Σ c."""
    waves = zip(*(arrays[f"wave_{each}"] for each in ("joint", "order", "sine", "cosine")), strict=True)
    by_order: dict[int, complex] = {}
    for own, order, sine, cosine in waves:
        if own == joint:
            by_order[round(order)] = by_order.get(round(order), 0j) + complex(cosine, -sine)
    highest = max(by_order, default=0)
    return [by_order.get(order, 0j) for order in range(highest, 0, -1)], sum(each.real for each in by_order.values())


@final
class FieldShift:
    """Σ w exp(−½ |q · scale − place|²), mm, the square multiplied out: two products of a matrix and a vector."""

    def __init__(self, arrays: Mapping[str, list[float]]) -> None:
        self._empty = not arrays["node_weight"]
        if self._empty:
            return
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
        import numpy as np

        self._array, self._exp = np.array, np.exp
        place, scale = (np.array(arrays[each]).reshape(-1, AXES) for each in ("node_place", "node_scale"))
        self._factors = np.hstack([scale * place, -0.5 * scale**2, -0.5 * (place**2).sum(axis=1)[:, None]])
        self._weight = np.array(arrays["node_weight"]).reshape(3, -1)

    def at(self, q: Sequence[float]) -> Vector:
        """At model angles q, rad, along the robot's base."""
        if self._empty:
            return _STILL
        values = self._array([*q, *(angle * angle for angle in q), 1.0])
        u, v, w = (self._weight @ self._exp(self._factors @ values)).tolist()
        return (u, v, w)
