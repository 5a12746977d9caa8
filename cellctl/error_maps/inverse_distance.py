"""Inverse-distance weighting on a grid of the workspace: a baseline."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import final

import numpy as np
from numpy.typing import ArrayLike

from cellctl.error_maps.samples import Method, Tuned
from cellctl.kinematics import Floats

PITCH_SHARES = (0.02, 0.05, 0.1, 0.2, 0.35)
"""Pitches that are tried, as shares of the longest side of the samples' box."""

POWERS = (1.0, 2.0, 3.0, 4.0, 6.0)

_BLOCK = 256
"""Grid points whose distances to all samples are held at a time."""


@final
@dataclass(frozen=True, eq=False)
class GridMap:
    """Errors at the points of a grid, and between them.

    inputs (N, k), errors (N, m): the samples. pitch: side of a cell, unit of the inputs. power: of the distance.
    """

    inputs: Floats
    samples: Floats
    pitch: float
    power: float

    def errors(self, inputs: ArrayLike) -> Floats:
        """Errors (M, m) at inputs (M, k): the mean of the 2^k corners of the cell, weighted by 1 / distance^power."""
        at = np.atleast_2d(np.asarray(inputs, float))
        origin = self.inputs.min(axis=0)
        cell = np.floor((at - origin) / self.pitch)
        corners = cell[:, None] + np.array(list(product((0.0, 1.0), repeat=at.shape[1])))
        unique, which = np.unique(corners.reshape(-1, at.shape[1]), axis=0, return_inverse=True)
        places = origin + self.pitch * unique
        found = [self._at(places[start : start + _BLOCK]) for start in range(0, len(places), _BLOCK)]
        values = np.concatenate(found)[which.reshape(corners.shape[:2])]
        apart = np.linalg.norm(at[:, None] - (origin + self.pitch * corners), axis=2)
        return np.asarray(np.einsum("nc,ncm->nm", _weights(apart, self.power), values))

    def _at(self, places: Floats) -> Floats:
        """Errors (M, m) at grid points (M, k), from all samples."""
        apart = np.linalg.norm(places[:, None] - self.inputs, axis=2)
        return np.asarray(_weights(apart, self.power) @ self.samples)


@final
@dataclass(frozen=True)
class GridInverseDistance(Method):
    """Inverse-distance weighting on a cubic grid, from samples anywhere.

    pitch: side of a cell, unit of the inputs (mm). power: of the distance. The published method (Guo et al. 2024,
    reference 32 of the kriging paper; its settings are not published) measures the corners of a grid. Here the samples
    are not on a grid, so this is our definition: the error at a grid point is the mean of all samples weighted by
    1 / distance^power, and the error at a place the mean of its cell's corners with the same weights. A sample at the
    place itself is its value; repeats there are averaged.
    """

    pitch: float
    power: float

    def fit_checked(self, inputs: Floats, errors: Floats) -> GridMap:
        """The map of errors (N, m) sampled at places (N, k)."""
        return GridMap(inputs, errors, self.pitch, self.power)


def tuned_grid(inputs: ArrayLike, *, seed: int = 0, powers: Sequence[float] = POWERS) -> Tuned[GridInverseDistance]:
    """Pitch and power by cross-validation, for samples at these places (N, k)."""
    side = float(np.ptp(np.asarray(inputs, float), axis=0).max())
    candidates = [GridInverseDistance(share * side, power) for share in PITCH_SHARES for power in powers]
    return Tuned(candidates, seed=seed)


def _weights(apart: Floats, power: float) -> Floats:
    """Weights (M, N) that sum to 1 in each row; at distance 0 all others have none."""
    nearest = apart.min(axis=1, keepdims=True)
    scaled = np.where(nearest > 0.0, apart / np.where(nearest > 0.0, nearest, 1.0), np.where(apart > 0.0, np.inf, 1.0))
    weights = scaled**-power
    return np.asarray(weights / weights.sum(axis=1, keepdims=True))
