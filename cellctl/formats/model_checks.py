"""Checks of a model file for content that no fit writes: each raises ValueError with the error."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from cellctl.kinematics import Floats

GREATEST = 1e9
"""No parameter, and no σ, is greater than this, in any unit."""


def of_this_format(content: Any, ours: str) -> Any:
    """`content` of a file, where it states the format `ours`."""
    theirs = content.get("format") if isinstance(content, dict) else None
    if not isinstance(theirs, str) or not theirs.startswith(ours.rstrip("0123456789")):
        raise ValueError(f'it does not say "format": "{ours}"')
    if theirs != ours:
        raise ValueError(
            f"it is of format '{theirs}', and this cellctl reads '{ours}': give it to the one that wrote it"
        )
    return content


def check_postures(postures: Sequence[Sequence[float]] | None, joints: int, what: str) -> None:
    """Refuse postures (M, n), if any, with another number of joints than the robot; what: their name in the error."""
    if any(len(posture) != joints for posture in postures or ()):
        raise ValueError(f"the postures of its {what} are not those of its robot")


def check_covariance(covariance: Floats) -> None:
    """Refuse a covariance (P, P) that is not symmetric, or has a variance below 0 along any combination."""
    import numpy as np

    variances = np.diag(covariance)
    scale = np.sqrt(np.where(variances > 0.0, variances, 1.0))
    scaled = covariance / scale / scale[:, None]
    symmetric = np.isfinite(scaled).all() and np.allclose(scaled, scaled.T, atol=1e-6)
    if not symmetric or (variances < 0.0).any() or (variances > GREATEST**2).any():
        raise ValueError("its covariance is none: not symmetric, or a variance below 0")
    if len(scaled) and np.linalg.eigvalsh(scaled).min() < -1e-6:
        raise ValueError("its covariance is none: some combination of parameters has a variance below 0")


def check_sigmas(covariance: Sequence[Sequence[float]], sigmas: Sequence[float]) -> None:
    """Refuse σ (P,) of the parameters that are not those of their covariance (P, P)."""
    variances = [row[place] for place, row in enumerate(covariance)]
    pairs = zip(sigmas, variances, strict=True)
    if not all(math.isclose(sigma, math.sqrt(variance), rel_tol=1e-6) for sigma, variance in pairs):
        raise ValueError("its covariance does not go with the σ of its parameters")
