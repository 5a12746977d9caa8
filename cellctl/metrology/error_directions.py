"""Position errors by direction in the robot's base frame, and their change of scale."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np

from cellctl.kinematics import Floats


@final
@dataclass(frozen=True, slots=True)
class ErrorDirections:
    """RMS of N errors by direction, mm: x, y, z (vertical) of the base frame, radial (from A1's axis), tangential.

    scale_ppm, scale_sigma_ppm: the factor by which the errors grow with the distance between places, with its 1 σ from
    their scatter.
    """

    x: float
    y: float
    z: float
    radial: float
    tangential: float
    scale_ppm: float
    scale_sigma_ppm: float


def error_directions(places: Floats, errors: Floats) -> ErrorDirections:
    """Directions of `errors` (N, 3) at `places` (N, 3), mm, both in the base frame; N ≥ 2.

    Scale: least squares of e = s (p − p̄) + shift; s > 0: the true places are further apart than those of the model.
    """
    x, y, z = np.sqrt(np.mean(errors**2, axis=0)).tolist()
    out = places[:, :2] / np.linalg.norm(places[:, :2], axis=1, keepdims=True)
    radial = np.sum(errors[:, :2] * out, axis=1)
    tangential = errors[:, 1] * out[:, 0] - errors[:, 0] * out[:, 1]
    away, off = places - places.mean(axis=0), errors - errors.mean(axis=0)
    spread = float(np.sum(away**2))
    scale = float(np.sum(away * off)) / spread
    rest = off - scale * away
    sigma = np.sqrt(np.sum(rest**2) / (rest.size - 4) / spread)
    return ErrorDirections(x, y, z, _rms(radial), _rms(tangential), 1e6 * scale, 1e6 * float(sigma))


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))
