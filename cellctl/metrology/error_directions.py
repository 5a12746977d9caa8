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

    scale_ppm, scale_sigma_ppm: the factor by which the true places are further apart than the model's, with 1 σ.
    """

    x: float
    y: float
    z: float
    radial: float
    tangential: float
    scale_ppm: float
    scale_sigma_ppm: float


def error_directions(places: Floats, errors: Floats, registration: Floats) -> ErrorDirections:
    """Directions of `errors` (N, 3) at `places` (N, 3), mm, both in the base frame.

    registration (N, 3, R): how the places follow the parameters that registered the model. The scale is found together
    with these parameters, e = s p + J x: a registered reflector offset takes up a part of a wrong scale otherwise. Its
    σ is from the scatter that is left. Raises ValueError with fewer than R + 2 numbers.
    """
    x, y, z = np.sqrt(np.mean(errors**2, axis=0)).tolist()
    out = places[:, :2] / np.linalg.norm(places[:, :2], axis=1, keepdims=True)
    radial = np.sum(errors[:, :2] * out, axis=1)
    tangential = errors[:, 1] * out[:, 0] - errors[:, 0] * out[:, 1]
    return ErrorDirections(x, y, z, _rms(radial), _rms(tangential), *_scale(places, errors, registration))


def _scale(places: Floats, errors: Floats, registration: Floats) -> tuple[float, float]:
    """The scale and its 1 σ, ppm."""
    if errors.size < registration.shape[-1] + 2:
        raise ValueError(f"{len(errors)} places do not show a scale beside {registration.shape[-1]} other parameters")
    basis = np.linalg.qr(registration.reshape(errors.size, -1))[0]
    away, off = (flat - basis @ (basis.T @ flat) for flat in (places.ravel(), errors.ravel()))
    spread = float(away @ away)
    scale = float(away @ off) / spread
    rest = off - scale * away
    variance = float(rest @ rest) / (errors.size - basis.shape[1] - 1)
    return 1e6 * scale, 1e6 * float(np.sqrt(variance / spread))


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))
