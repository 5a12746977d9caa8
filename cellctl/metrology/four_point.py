"""Tool centre point from several poses with the tip at one fixed point (SPH section 5.3, "XYZ 4-point").

Flange pose (R_i, p_i) and tip t: R_i t + p_i = f, the same place f each time: linear in t and f.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import ArrayLike

from cellctl.kinematics import Floats

LEAST_TILT_DEG = 15.0
"""Orientations closer together than this in all directions do not determine the tip."""


class TooAlike(ValueError):
    """The poses do not determine the tip; the text says what to do."""


@final
@dataclass(frozen=True, eq=False)
class ToolPoint:
    """tip (3,), mm, in the flange frame, covariance (3, 3); place (3,): the fixed point in the base frame.

    residual (N, 3), mm; scatter_mm: σ of a coordinate from the residuals (NaN without redundancy).
    """

    tip: Floats
    covariance: Floats
    place: Floats
    residual: Floats
    scatter_mm: float

    @property
    def sigma(self) -> Floats:
        """Standard deviations of the tip's coordinates (3,), mm."""
        return np.sqrt(np.diag(self.covariance))


def tool_point(flange: ArrayLike, sigma_mm: float | None = None) -> ToolPoint:
    """The tip by flange poses (N, 4, 4), mm, N ≥ 4; sigma_mm: of a coordinate of robot and touch, None: from residuals.

    Residuals do not show an error of the robot that is the same in all poses. Raises TooAlike.
    """
    poses = np.asarray(flange, float)
    if len(poses) < 4:
        raise TooAlike(f"{len(poses)} poses at the fixed point: take at least 4")
    rows = np.concatenate([poses[:, :3, :3], np.tile(-np.eye(3), (len(poses), 1, 1))], axis=2).reshape(-1, 6)
    right = -poses[:, :3, 3].ravel()
    if _spread(poses[:, :3, :3]) < np.radians(LEAST_TILT_DEG):
        raise TooAlike(
            f"the tool's orientations differ too little: turn it by {LEAST_TILT_DEG:g}° or more about two axes"
        )
    found = np.linalg.lstsq(rows, right, rcond=None)[0]
    residual = (rows @ found - right).reshape(-1, 3)
    scatter = float(np.sqrt((residual**2).sum() / (residual.size - 6)))
    sigma = scatter if sigma_mm is None else sigma_mm
    covariance = sigma**2 * np.linalg.inv(rows.T @ rows)[:3, :3]
    return ToolPoint(found[:3], covariance, found[3:], residual, scatter)


def _spread(turns: Floats) -> float:
    """How far the orientations determine the least determined direction of the tip, as an angle (rad) between them."""
    rows = (turns - turns.mean(axis=0)).reshape(-1, 3)
    return float(np.linalg.svd(rows, compute_uv=False)[-1] / np.sqrt(len(turns) / 2.0))
