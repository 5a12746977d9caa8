"""A circle in space through points with covariances: one joint turned alone carries a reflector around its axis.

Two residuals for each point: its height h = z·(x − c) over the circle's plane, and its distance from the axis less the
radius, ρ − r. Their covariance follows from the points'; generalised least squares by Gauss–Newton from a closed form
(plane by SVD, circle by Kåsa's linear equations).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, final

import numpy as np
from numpy.typing import ArrayLike
from scipy import stats

from cellctl.kinematics import Bools, Floats
from cellctl.metrology.points import Points, whitened

STEPS = 30
OUTLYING = 1e-3
"""Probability that a circle without outliers has a point flagged as one."""
LEAST_POINTS = 5
"""Points below which no outlier is looked for; a circle itself needs 3."""
LEAST_ARC = 1e-3
"""Smallest sagitta of the points' arc as a share of its chord."""


class NoCircle(ValueError):
    """Points do not determine a circle; the text says why and what to do."""


@final
@dataclass(frozen=True, eq=False)
class Circle:
    """A fitted circle, mm. centre (3,); direction (3,): unit vector of its axis, right-handed to the turn; radius.

    covariance (7, 7): of centre, direction, radius; it has rank 6, as the direction keeps its length. gain (7, 3N): by
    which these follow small changes of the points. inliers (N,). height, radial (N,): residuals of all points, mm.
    chi2 and dof: of the inliers.
    """

    centre: Floats
    direction: Floats
    radius: float
    covariance: Floats
    gain: Floats
    inliers: Bools
    height: Floats
    radial: Floats
    chi2: float
    dof: int

    @property
    def sigma_centre(self) -> Floats:
        """Standard deviations of the centre's coordinates (3,), mm."""
        return np.sqrt(np.diag(self.covariance)[:3])

    @property
    def sigma_direction(self) -> float:
        """Standard deviation of the direction, rad: root of the mean over the two directions across it."""
        return float(np.sqrt(np.trace(self.covariance[3:6, 3:6]) / 2.0))

    @property
    def sigma_radius(self) -> float:
        """Standard deviation of the radius, mm."""
        return float(np.sqrt(self.covariance[6, 6]))

    @property
    def p_value(self) -> float:
        """Probability of residuals at least this large if the stated covariances are right."""
        return float(stats.chi2.sf(self.chi2, self.dof)) if self.dof else 1.0


class _Shape(NamedTuple):
    centre: Floats
    direction: Floats
    radius: float


def fit_circle(points: Points, angles: ArrayLike | None = None) -> Circle:
    """The circle through `points`, in the order of the turn; outliers are left out and flagged.

    angles (N,), rad: of the joint that turned; they decide the sense of the direction. Without them the points turn
    positively. Raises NoCircle for fewer than three points, or points on a line.
    """
    if len(points) < 3:
        raise NoCircle(f"{len(points)} points do not determine a circle: measure at least 3, better 8 or more")
    inliers = np.ones(len(points), bool)
    start = _closed_form(points.xyz)
    while True:
        fitted = _Fit.of(points, inliers, start)
        worst = fitted.outlier() if np.count_nonzero(inliers) > LEAST_POINTS else None
        if worst is None:
            return fitted.circle(_sense(points.xyz, fitted.shape, angles))
        inliers = inliers.copy()
        inliers[worst] = False
        start = _closed_form(points.xyz[inliers])


def _closed_form(xyz: Floats) -> _Shape:
    """Plane of the points by SVD; in it 2 c·x + (r² − c²) = x² by linear least squares (Kåsa 1976)."""
    middle = xyz.mean(axis=0)
    _, spread, axes = np.linalg.svd(xyz - middle)
    if spread[1] < LEAST_ARC * spread[0]:
        raise NoCircle("the points lie on a line, or are one point: turn the joint through a larger angle")
    flat = (xyz - middle) @ axes[:2].T
    lines = np.column_stack([2.0 * flat, np.ones(len(flat))])
    x, y, rest = np.linalg.lstsq(lines, (flat**2).sum(axis=1), rcond=None)[0]
    return _Shape(middle + axes[0] * x + axes[1] * y, axes[2], float(np.sqrt(max(rest + x * x + y * y, 0.0))))


@final
@dataclass(frozen=True, eq=False)
class _Fit:
    """The fit to the inliers; arrays of 2 rows for each of the M inliers (height, radial) and 6 parameters."""

    points: Points
    inliers: Bools
    shape: _Shape
    residual: Floats
    jacobian: Floats
    covariance: Floats
    projection: Floats

    @classmethod
    def of(cls, points: Points, inliers: Bools, start: _Shape) -> _Fit:
        mine = points.pick(inliers)
        together, shape = mine.together(), start
        for _ in range(STEPS):
            fit = cls._at(points, inliers, shape, mine.xyz, together)
            rows, residual = whitened(fit.covariance, fit.jacobian, fit.residual)
            step = np.asarray(np.linalg.lstsq(rows, -residual, rcond=None)[0], float)
            shape = _stepped(shape, step)
            if np.abs(step / ([1.0 / shape.radius] * 2 + [1.0] * 4)).max() < 1e-9:
                break
        return cls._at(points, inliers, shape, mine.xyz, together)

    @classmethod
    def _at(cls, points: Points, inliers: Bools, shape: _Shape, xyz: Floats, together: Floats) -> _Fit:
        e1, e2 = _across(shape.direction)
        away, height, outward, distance = _cylindrical(xyz, shape)
        count = len(xyz)
        jacobian = np.zeros((count, 2, 6))
        jacobian[:, 0, :2], jacobian[:, 0, 4] = away @ np.column_stack([e1, e2]), -1.0
        jacobian[:, 1, 2:4], jacobian[:, 1, 5] = -outward @ np.column_stack([e1, e2]), -1.0
        projection = np.zeros((count, 2, count, 3))
        projection[np.arange(count), 0, np.arange(count)] = shape.direction
        projection[np.arange(count), 1, np.arange(count)] = outward
        flat = projection.reshape(2 * count, 3 * count)
        residual = np.column_stack([height, distance - shape.radius]).ravel()
        return cls(points, inliers, shape, residual, jacobian.reshape(-1, 6), flat @ together @ flat.T, flat)

    def _normal_inverse(self) -> tuple[Floats, Floats]:
        """P = (Jᵀ W J)⁻¹ (6, 6), and the whitened Jacobian L⁻¹ J (2M, 6), W⁻¹ = L Lᵀ."""
        (rows,) = whitened(self.covariance, self.jacobian)
        return np.asarray(np.linalg.pinv(rows.T @ rows, hermitian=True)), rows

    def outlier(self) -> int | None:
        """Index of the point whose removal lowers χ² most, if by more than chance allows; otherwise None.

        Baarda's test for correlated rows: (W v)_iᵀ (W − W J P Jᵀ W)_ii⁻¹ (W v)_i is χ² with 2 degrees of freedom. It is
        divided by its median where all rows scatter more than stated.
        """
        inverse, _ = self._normal_inverse()
        weight = np.linalg.inv(self.covariance)
        pulled = (weight @ self.residual).reshape(-1, 2)
        rest = weight - weight @ self.jacobian @ inverse @ self.jacobian.T @ weight
        blocks = np.stack([rest[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] for i in range(len(pulled))])
        tests = np.einsum("ni,nij,nj->n", pulled, np.linalg.pinv(blocks, hermitian=True), pulled)
        tests /= max(1.0, float(np.median(tests)) / stats.chi2.median(2))
        worst = int(tests.argmax())
        if tests[worst] < stats.chi2.isf(OUTLYING / len(tests), 2):
            return None
        return int(np.flatnonzero(self.inliers)[worst])

    def circle(self, sense: float) -> Circle:
        """The result, its direction times `sense` (1 or −1)."""
        inverse, rows = self._normal_inverse()
        e1, e2 = _across(self.shape.direction)
        spread = np.zeros((7, 6))
        spread[:3, 2:5] = np.column_stack([e1, e2, self.shape.direction])
        spread[3:6, :2] = sense * np.column_stack([e1, e2])
        spread[6, 5] = 1.0
        (projection,) = whitened(self.covariance, self.projection)
        gain = np.zeros((7, len(self.inliers), 3))
        gain[:, self.inliers] = (-spread @ inverse @ rows.T @ projection).reshape(7, -1, 3)
        (residual,) = whitened(self.covariance, self.residual)
        _, height, _, distance = _cylindrical(self.points.xyz, self.shape)
        return Circle(
            self.shape.centre,
            sense * self.shape.direction,
            self.shape.radius,
            spread @ inverse @ spread.T,
            gain.reshape(7, -1),
            self.inliers,
            height,
            distance - self.shape.radius,
            float(residual @ residual),
            len(residual) - 6,
        )


def _stepped(shape: _Shape, step: Floats) -> _Shape:
    """Tilt along e1, e2; centre along e1, e2, axis; radius."""
    e1, e2 = _across(shape.direction)
    direction = shape.direction + step[0] * e1 + step[1] * e2
    centre = shape.centre + step[2] * e1 + step[3] * e2 + step[4] * shape.direction
    return _Shape(centre, direction / np.linalg.norm(direction), shape.radius + float(step[5]))


def _cylindrical(xyz: Floats, shape: _Shape) -> tuple[Floats, Floats, Floats, Floats]:
    """From centre (N, 3), height (N,), unit vector away from the axis (N, 3), distance from it (N,)."""
    away = xyz - shape.centre
    height = away @ shape.direction
    flat = away - height[:, None] * shape.direction
    distance = np.linalg.norm(flat, axis=1)
    return away, height, flat / np.maximum(distance, 1e-9)[:, None], distance


def _across(direction: Floats) -> tuple[Floats, Floats]:
    """Two unit vectors (3,) perpendicular to `direction` and to each other."""
    e1 = np.cross(np.eye(3)[np.abs(direction).argmin()], direction)
    e1 /= np.linalg.norm(e1)
    return e1, np.cross(direction, e1)


def _sense(xyz: Floats, shape: _Shape, angles: ArrayLike | None) -> float:
    """1 where the points turn positively about the direction as the angles grow, −1 otherwise."""
    away = xyz - shape.centre
    turned = np.cross(away[:-1], away[1:]) @ shape.direction
    growth = np.ones(len(turned)) if angles is None else np.diff(np.asarray(angles, float))
    return 1.0 if float(turned @ np.sign(growth)) >= 0.0 else -1.0
