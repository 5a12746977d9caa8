"""Points in the unit cube, batch after batch: quasi-random, pseudo-random, and clustered as a person would choose."""

from __future__ import annotations

from typing import Literal, Protocol, TypeAlias, final, get_args

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

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
            return qmc.Sobol(dimensions, rng=rng)
        case "halton":
            return qmc.Halton(dimensions, rng=rng)
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
