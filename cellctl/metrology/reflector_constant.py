"""Error of the reflector constant, by known distances between nests.

A wrong constant k makes every range longer by k: along each beam u. A distance between two nests then changes by
k (u1 − u2)·e, with e from nest 2 to nest 1: by 2 k with the station between them, in line; by nothing with both nests
in line on one side. A robot's scale takes most of such an error for its own, so that its residuals do not show it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, final

import numpy as np
from scipy import stats

from cellctl.kinematics import Floats
from cellctl.metrology.points import Points, block_diagonal

LEAST_SENSITIVITY = 0.2
"""Change of a distance per change of the constant below which it says too little of it."""


class InsensitiveDistances(ValueError):
    """No known distance changes with the reflector constant; the text says what to do."""


class KnownDistance(NamedTuple):
    """Distance between nests `first` and `second` (indices), mm, and its standard deviation."""

    first: int
    second: int
    mm: float
    sigma_mm: float


@final
@dataclass(frozen=True, slots=True)
class ConstantError:
    """error_mm: how much too large every range is, with sigma_mm; subtract it from the constant if `wrong`.

    zero_sigma_mm: 1 σ of the zero of the instrument's range, which looks the same. p_value: of this estimate if there
    is no other error than that. sensitivity: the largest change of a distance per change of the constant.
    """

    error_mm: float
    sigma_mm: float
    zero_sigma_mm: float
    p_value: float
    sensitivity: float
    wrong: bool


def constant_error(
    nests: Points, distances: Sequence[KnownDistance], *, scale_ppm: float = 1.0, alpha: float = 1e-3
) -> ConstantError:
    """Estimate it by generalised least squares from nests (N) in the instrument's frame and known distances.

    scale_ppm: σ of the instrument's scale, the same in all distances. The zero of its range is known to the common part
    of the points along their beams: an error of that size is no sign of a wrong constant. Raises InsensitiveDistances
    where no distance changes by at least a fifth of the constant's error.
    """
    pairs = [(one.first, one.second) for one in distances]
    rows, sensitivity = _rows(nests.xyz, pairs)
    if not len(pairs) or np.abs(sensitivity).max() < LEAST_SENSITIVITY:
        raise InsensitiveDistances(
            "no known distance between nests changes with the reflector constant: give a certified distance between "
            "two nests that the station sees in different directions, best with the station between them"
        )
    found = np.array([np.linalg.norm(nests.xyz[i] - nests.xyz[j]) for i, j in pairs])
    known, sigma = np.array([one.mm for one in distances]), np.array([one.sigma_mm for one in distances])
    covariance = rows @ block_diagonal(nests.alone) @ rows.T + np.diag(sigma**2)
    covariance += (scale_ppm * 1e-6) ** 2 * np.outer(found, found)
    weighted = np.linalg.solve(covariance, sensitivity)
    spread = 1.0 / float(sensitivity @ weighted)
    error = spread * float(weighted @ (found - known))
    zero = float(nests.range_sigma.max())
    p_value = float(2.0 * stats.norm.sf(abs(error) / np.hypot(np.sqrt(spread), zero)))
    return ConstantError(
        error, float(np.sqrt(spread)), zero, p_value, float(np.abs(sensitivity).max()), p_value < alpha
    )


def _rows(xyz: Floats, pairs: Sequence[tuple[int, int]]) -> tuple[Floats, Floats]:
    """Derivatives of the distances by the points (D, 3N), and by the constant (D,)."""
    beams = xyz / np.linalg.norm(xyz, axis=1, keepdims=True)
    rows, sensitivity = np.zeros((len(pairs), len(xyz), 3)), np.zeros(len(pairs))
    for row, (i, j) in enumerate(pairs):
        between = xyz[i] - xyz[j]
        unit = between / np.linalg.norm(between)
        rows[row, i], rows[row, j] = unit, -unit
        sensitivity[row] = (beams[i] - beams[j]) @ unit
    return rows.reshape(len(pairs), -1), sensitivity
