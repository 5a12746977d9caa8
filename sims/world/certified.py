"""Centres whose spacings are true to their certificate."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from sims.spacings import Distance
from sims.world.screws import Vector

_STEPS = 50


def certified(
    rough: Mapping[str, Vector], distances: Sequence[Distance], random: np.random.Generator, scale: float
) -> NDArray[np.float64]:
    """Centres (N, 3), mm, nearest to the rough places whose distances are as certified, each ± its σ × `scale`.

    Where the distances contradict each other, they are met by weighted least squares.
    """
    rank = {name: i for i, name in enumerate(rough)}
    pairs = [tuple(rank[name] for name in distance.between) for distance in distances]
    sigmas = np.array([distance.sigma for distance in distances])
    lengths = np.array([distance.mm for distance in distances]) + scale * random.normal(0.0, sigmas)
    weights = 1.0 / np.maximum(sigmas, 1e-6)
    centres = np.array(list(rough.values()), dtype=float)
    for _ in range(_STEPS if pairs else 0):
        jacobian, spacings = _spacings(centres, pairs)
        step, *_ = np.linalg.lstsq(jacobian * weights[:, None], (lengths - spacings) * weights, rcond=None)
        centres += step.reshape(-1, 3)
        if np.abs(step).max() < 1e-9:
            break
    return centres


def _spacings(
    centres: NDArray[np.float64], pairs: Sequence[tuple[int, ...]]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    jacobian = np.zeros((len(pairs), *centres.shape))
    spacings = np.zeros(len(pairs))
    for row, (i, j) in enumerate(pairs):
        apart = centres[i] - centres[j]
        spacings[row] = np.linalg.norm(apart)
        jacobian[row, i] = apart / spacings[row]
        jacobian[row, j] = -jacobian[row, i]
    return jacobian.reshape(len(pairs), -1), spacings
