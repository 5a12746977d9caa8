"""Regions that targets are drawn from, of positions or joints, and the points of the unit cube drawn for them.

A region maps the unit cube to its points, so that each way of drawing serves each region.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol, TypeAlias, final, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cellctl.kinematics import pose, rotation_from_abc
from cellctl.kinematics.low_discrepancy import halton, sobol

Array = NDArray[np.float64]
Sequence: TypeAlias = Literal["sobol", "halton", "pseudo-random", "clustered"]
SEQUENCES: tuple[Sequence, ...] = get_args(Sequence)

ROWS_PER_CLUSTER, CLUSTER_WIDTH = 10, 0.05
"""A person moves the robot to one place for each ten points, and varies each coordinate there by 5 % of its range
(1 σ)."""


class Draw(Protocol):
    """A sequence of points in the unit cube."""

    def random(self, count: int) -> Array:
        """The next `count` points (count, d)."""
        ...


def draw_of(sequence: Sequence, dimensions: int, count: int, rng: np.random.Generator) -> Draw:
    """A sequence in the unit cube of `dimensions`; `count`: the points wanted in the end (sets the number of clusters).

    Sobol (Owen-scrambled) is balanced in batches of a power of two. Halton is scrambled too. pseudo-random and
    clustered are baselines.
    """
    match sequence:
        case "sobol":
            return sobol(dimensions, rng=rng)
        case "halton":
            return halton(dimensions, rng=rng)
        case "pseudo-random":
            return _PseudoRandom(dimensions, rng)
        case "clustered":
            return _Clustered(dimensions, count, rng)


@final
class _PseudoRandom:
    def __init__(self, dimensions: int, rng: np.random.Generator) -> None:
        self._dimensions, self._rng = dimensions, rng

    def random(self, count: int) -> Array:
        return self._rng.random((count, self._dimensions))


@final
class _Clustered:
    """Points around a few places, place after place in turn; those outside the cube are moved to its wall."""

    def __init__(self, dimensions: int, count: int, rng: np.random.Generator) -> None:
        self._rng, self._drawn = rng, 0
        self._places = rng.random((max(2, round(count / ROWS_PER_CLUSTER)), dimensions))

    def random(self, count: int) -> Array:
        which = np.arange(self._drawn, self._drawn + count) % len(self._places)
        self._drawn += count
        away = self._rng.normal(0.0, CLUSTER_WIDTH, (count, self._places.shape[1]))
        return np.clip(self._places[which] + away, 0.0, 1.0)


@final
@dataclass(frozen=True, eq=False)
class TaskWorkspace:
    """Positions in a box, orientations R = Rz(A) Ry(B) Rx(C) in ranges. low, high (6,): X, Y, Z in mm, A, B, C in deg.

    Orientations are uniform as rotations (Haar measure), not as angles: A and C are uniform in their ranges, B has a
    density in proportion to |cos B|. At B = ±90° A and C turn about the same axis: uniform angles would put too many
    rotations there. A range without width is a constant.

    Raises ValueError for a range that is upside down or not finite, A or C wider than 360°, or B wider than 180° or
    beyond ±180° (it would draw the same rotation twice).
    """

    low: Array
    high: Array

    @classmethod
    def of(cls, ranges: ArrayLike) -> TaskWorkspace:
        """From ranges (6, 2): lower and upper end of X, Y, Z (mm), A, B, C (deg)."""
        ends = np.asarray(ranges, float)
        return cls(ends[:, 0], ends[:, 1])

    def __post_init__(self) -> None:
        _check(["X", "Y", "Z", "A", "B", "C"], self.low, self.high)
        width = self.high[3:] - self.low[3:]
        if width[0] > 360.0 or width[2] > 360.0:
            raise ValueError("a range of A or C is wider than 360°: the same rotation would be drawn twice")
        if width[1] > 180.0 or abs(self.low[4]) > 180.0 or abs(self.high[4]) > 180.0:
            raise ValueError(
                "the range of B is wider than 180° or beyond ±180°: the same rotation would be drawn twice"
            )

    def holds(self, positions: Array) -> bool:
        """Whether all `positions` (N, 3), mm, lie in the box."""
        inside = (positions >= self.low[:3] - 1e-6) & (positions <= self.high[:3] + 1e-6)
        return bool(inside.all())

    def poses(self, unit: Array) -> Array:
        """Poses (N, 4, 4), mm, of points `unit` (N, 6) in the unit cube."""
        values = self.low + unit * (self.high - self.low)
        values[:, 4] = _by_cosine(unit[:, 4], self.low[4], self.high[4])
        return pose(rotation_from_abc(values[:, 3:]), values[:, :3])


@final
@dataclass(frozen=True, eq=False)
class JointRanges:
    """Ranges of the controller's readings, low, high (n,), deg. Raises ValueError where one is upside down."""

    low: Array
    high: Array

    def __post_init__(self) -> None:
        _check([f"A{number}" for number in range(1, len(self.low) + 1)], self.low, self.high)

    def readings(self, unit: Array) -> Array:
        """Readings (N, n), deg, of points `unit` (N, n) in the unit cube."""
        return np.asarray(self.low + unit * (self.high - self.low))


def _check(names: list[str], low: Array, high: Array) -> None:
    for name, lower, upper in zip(names, low, high, strict=True):
        if not (np.isfinite(lower) and np.isfinite(upper) and lower <= upper):
            raise ValueError(f"the range of {name} is {lower:g}…{upper:g}: the lower end comes first")


def _by_cosine(share: Array, low: float, high: float) -> Array:
    """Angles in `low`…`high`, deg, of shares (N,): their density is in proportion to |cos|."""
    if low == high:
        return np.full(len(share), low)
    ends = _area(np.array([low, high]))
    return _angle(ends[0] + share * (ends[1] - ends[0]))


def _area(angle: Array) -> Array:
    """∫|cos| from 0 to `angle` (deg, within ±180°)."""
    sine = np.sin(np.deg2rad(np.abs(angle)))
    return np.asarray(np.sign(angle) * np.where(np.abs(angle) <= 90.0, sine, 2.0 - sine))


def _angle(area: Array) -> Array:
    """The inverse of `_area`, deg."""
    size = np.clip(np.abs(area), 0.0, 2.0)
    within = np.rad2deg(np.arcsin(np.where(size <= 1.0, size, 2.0 - size)))
    return np.asarray(np.sign(area) * np.where(size <= 1.0, within, 180.0 - within))
