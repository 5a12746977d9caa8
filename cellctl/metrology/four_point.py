"""The tool centre point from flange poses at one fixed point, by touches on a sphere or with the tip at the point.

The four-point method (SPH 5.3): with the flange at (R, p) and the tool's offset t, the tip is at p + R t. The tip at
an unknown point c in several orientations gives p + R t = c; a touch on a sphere about c gives |p + R t − c| = reach.
The robot's model is taken as it is, so its errors enter: they differ from orientation to orientation and are common to
the touches of one. Their size is estimated from the residuals (restricted maximum likelihood) and is part of σ.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, Self, final

import numpy as np
from scipy.optimize import minimize_scalar

from cellctl.calibration.rows.fixed_points import sphere_centre
from cellctl.kinematics import Floats

LEAST_ORIENTATIONS = 4
"""Orientations that the method requires: three determine tool and point, the fourth shows that they agree."""

_STEPS, _SETTLED_MM = 30, 1e-9
_LARGEST_COMMON_MM = 20.0


@final
@dataclass(frozen=True, eq=False)
class FoundTool:
    """A tool found at one point. tool (3,): TCP in the flange frame; point (3,): base frame, mm.

    covariance (6, 6), mm²: of tool, then point. residuals (N, k): of each contact, mm (k = 1 along the normal of a
    sphere, k = 3 at a point). sigma_mm: 1 σ of one residual number by noise; common_mm: 1 σ per axis of the part that
    the contacts of one orientation share (None: one contact each, not separable). Both are estimated from the
    residuals; sigma_mm is at least the stated one.
    """

    tool: Floats
    point: Floats
    covariance: Floats
    residuals: Floats
    sigma_mm: float
    common_mm: float | None

    @property
    def sigma(self) -> Floats:
        """1 σ of the tool's x, y, z (3,), mm."""
        return np.asarray(np.sqrt(np.diag(self.covariance)[:3]))


@final
@dataclass(frozen=True, eq=False)
class _Linear:
    """The problem about a solution: residuals (M,), columns (M, 6), direction (M, 3) and group (M,) of each."""

    residuals: Floats
    columns: Floats
    directions: Floats
    group: Any

    def covariance(self, sigma: float, common: float) -> Floats:
        """Of the numbers (M, M), mm²: noise, and an error of each group that acts along the directions."""
        alike = self.group[:, None] == self.group
        shared = common**2 * alike * (self.directions @ self.directions.T)
        return np.asarray(sigma**2 * np.eye(len(self.residuals)) + shared)

    def loss(self, sigma: float, common: float) -> float:
        """−2 log of the restricted likelihood of the two sizes."""
        return self.solved(sigma, common)[2]

    def solved(self, sigma: float, common: float) -> tuple[Floats, Floats, float]:
        """The generalised least-squares step (6,), its covariance (6, 6), and −2 log of the restricted likelihood."""
        root = np.linalg.cholesky(self.covariance(sigma, common))
        columns, r = np.linalg.solve(root, self.columns), np.linalg.solve(root, self.residuals)
        information = columns.T @ columns
        covariance = np.linalg.inv(information)
        step = covariance @ columns.T @ r
        rest = r - columns @ step
        logs = 2.0 * np.log(np.diag(root)).sum() + np.linalg.slogdet(information)[1]
        return step, covariance, float(rest @ rest + logs)

    @classmethod
    def of_touches(cls, flanges: Floats, reach: Floats, group: Any, tool: Floats, point: Floats) -> Self:
        """Touches on a sphere about `tool` and `point`."""
        away = tips(flanges, tool) - point
        distance = np.linalg.norm(away, axis=-1)
        normals = away / distance[:, None]
        turned = np.einsum("nr,nrc->nc", normals, flanges[:, :3, :3])
        return cls(reach - distance, np.concatenate([turned, -normals], axis=1), normals, group)


def tips(flanges: Floats, tool: Floats) -> Floats:
    """TCPs (N, 3), mm, of `flanges` (N, 4, 4) with the offset `tool` (3,)."""
    return np.asarray(flanges[:, :3, 3] + flanges[:, :3, :3] @ tool)


def touch_residuals(flanges: Floats, reach: Floats, tool: Floats, point: Floats) -> Floats:
    """Distance (N,), mm, of each TCP from the surface: |tip − point| − reach."""
    return np.asarray(np.linalg.norm(tips(flanges, tool) - point, axis=-1) - reach)


def tool_by_touches(flanges: Floats, reach: Floats, orientation: Any, taught: Floats, sigma_mm: float) -> FoundTool:
    """Tool and sphere centre from touches: flange poses (N, 4, 4), reach (N,) = sphere's radius + tip's radius, mm.

    orientation (N,): number of the tool orientation; touches with the same number share an error. taught (3,): where
    the search starts. sigma_mm: stated 1 σ of one touch along the normal. Raises ValueError with fewer than four
    orientations, or if they are too much alike.
    """
    _require(len(np.unique(orientation)))
    tool, point = taught, sphere_centre(tips(flanges, taught), reach)
    sigma, common = sigma_mm, 0.0
    for _ in range(_STEPS):
        linear = _Linear.of_touches(flanges, reach, orientation, tool, point)
        _require_spread(linear.columns)
        sigma, common = _scatter(linear, sigma_mm)
        step, covariance, _ = linear.solved(sigma, common)
        tool, point = tool + step[:3], point + step[3:]
        if np.abs(step).max() < _SETTLED_MM:
            break
    residuals = touch_residuals(flanges, reach, tool, point)[:, None]
    return FoundTool(tool, point, covariance, residuals, sigma, common)


def tool_at_point(flanges: Floats, sigma_mm: float) -> FoundTool:
    """Tool and point from flange poses (N, 4, 4) with the tip at one point; N ≥ 4. sigma_mm: stated 1 σ on each axis.

    σ is the scatter of the residuals if that is larger. Raises ValueError as `tool_by_touches` does.
    """
    _require(len(flanges))
    columns = np.concatenate([flanges[:, :3, :3].reshape(-1, 3), np.tile(-np.eye(3), (len(flanges), 1))], axis=1)
    _require_spread(columns)
    found = np.linalg.lstsq(columns, -flanges[:, :3, 3].ravel(), rcond=None)[0]
    residuals = tips(flanges, found[:3]) - found[3:]
    scatter = np.sqrt(np.sum(residuals**2) / (residuals.size - 6))
    sigma = max(sigma_mm, float(scatter))
    covariance = sigma**2 * np.linalg.inv(columns.T @ columns)
    return FoundTool(found[:3], found[3:], covariance, residuals, sigma, None)


def _scatter(linear: _Linear, sigma_mm: float) -> tuple[float, float]:
    """Noise σ and common σ of the orientations, mm, by restricted maximum likelihood; σ is at least `sigma_mm`."""
    sigma, common = sigma_mm, 0.0
    for _ in range(4):
        common = _best(partial(linear.loss, sigma), 0.0)
        sigma = _best(partial(linear.loss, common=common), sigma_mm)
    return sigma, common


def _best(loss: Callable[[float], float], least: float) -> float:
    found = minimize_scalar(loss, bounds=(least, _LARGEST_COMMON_MM), method="bounded", options={"xatol": 1e-4})
    return least if loss(least) <= found.fun else float(found.x)


def _require(orientations: int) -> None:
    if orientations < LEAST_ORIENTATIONS:
        raise ValueError(f"{orientations} tool orientations do not determine a tool: {LEAST_ORIENTATIONS} at least")


def _require_spread(columns: Floats) -> None:
    """Raise ValueError if tool and point cannot be separated: the orientations are alike, or turn about one axis."""
    sizes = np.linalg.svd(columns, compute_uv=False)
    if sizes[-1] < 0.02 * sizes[0]:
        raise ValueError("the tool orientations are too much alike, or turn about one axis only, to find the tool")
