"""Kriging of position errors over the joints with a weight for each joint, as published.

Meng, Wei, Feng, Dong, Kang, Guo, Yang: A Robot Error Prediction and Compensation Method Using Joint Weights
Optimization Within Configuration Space. Appl. Sci. 2024, 14, 11682, doi 10.3390/app142411682. Equations 12–20.
The nugget is fitted and, as in the paper, not used. There is no unbiasedness constraint, whatever its title says.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Self, final

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.spatial.distance import cdist, pdist

from cellctl.error_maps.samples import Scale, checked
from cellctl.error_maps.semivariogram import EmpiricalSemivariogram, semivariogram
from cellctl.kinematics import Floats

REGULARISATION = 1e-3
"""λ, a share of the variance of the errors. The paper has no value. This one is noise of 3 % of their scatter: 0.03 mm
where the errors of a large arm scatter by 1 mm."""

UNRELATED = 1e-3
"""Range where the semivariogram does not rise, or has no model: each error counts at its own posture alone."""

INITIAL_WEIGHTS = np.array(
    [
        [0.5, 0.5, 1.5, 0.5, 2.0, 0.5],
        [1.5, 2.0, 0.5, 0.5, 0.5, 1.5],
        [1.5, 0.5, 2.0, 1.0, 1.5, 0.5],
    ]
)
"""W_init (3, 6): the paper's initial weights of joints 1 … 6, for the x, y and z error of its KR 300 R2500."""


@final
@dataclass(frozen=True, eq=False)
class Kriging:
    """The method. joint_weights (3, n): a weight of each joint, for the error along each axis; none given: all 1, the
    isotropic map. regularisation: λ.
    """

    joint_weights: Floats | None = None
    regularisation: float = REGULARISATION

    def fit(self, q: Floats, errors: Floats) -> KrigingMap:
        """The map of errors (N, 3), mm, actual − nominal, at model angles q (N, n), rad.

        Raises UnusableSamples (`samples.checked`), and ValueError for joint weights of another robot. A joint that
        never moved has no influence. An error that is constant is predicted as that constant.
        """
        q, errors = checked(q, errors)
        weights = np.ones((3, q.shape[1])) if self.joint_weights is None else np.asarray(self.joint_weights, float)
        if weights.shape != (3, q.shape[1]):
            raise ValueError(f"joint weights {weights.shape} for {q.shape[1]} joints: give (3, {q.shape[1]})")
        joints, scale = Scale.of(q), Scale.of(errors)
        standard, of_errors = joints.standardised(q), scale.standardised(errors)
        axes = [
            AxisMap.of(standard * own, error, self.regularisation)
            for own, error in zip(weights, of_errors.T, strict=True)
        ]
        return KrigingMap(joints, scale, weights, (axes[0], axes[1], axes[2]))


@final
@dataclass(frozen=True, eq=False)
class AxisMap:
    """The map of one standardised component. points (N, n): weighted standardised angles; semivariogram of their
    errors; range: C_r, of its model; pull (N,): (C + λI)⁻¹ e.
    """

    points: Floats
    semivariogram: EmpiricalSemivariogram
    range: float
    pull: Floats = field(repr=False)

    @classmethod
    def of(cls, points: Floats, error: Floats, regularisation: float) -> Self:
        """From weighted standardised angles (N, n) and standardised errors (N,)."""
        found = semivariogram(pdist(points), error)
        reach = found.model.range if found.model and found.model.sill > 0.0 else UNRELATED
        square = _covariance(points, points, reach) + regularisation * np.eye(len(points))
        return cls(points, found, reach, cho_solve(cho_factor(square, lower=True), error))

    def predicted(self, points: Floats) -> Floats:
        """wᵀe (M,) with w = (C + λI)⁻¹ c at weighted standardised angles (M, n)."""
        return np.asarray(_covariance(points, self.points, self.range) @ self.pull)


@final
@dataclass(frozen=True, eq=False)
class KrigingMap:
    """A fitted map (`ErrorMap`). joints, scale: of angles, rad, and errors, mm; joint_weights (3, n); axes: x, y, z."""

    joints: Scale
    scale: Scale
    joint_weights: Floats
    axes: tuple[AxisMap, AxisMap, AxisMap]

    def errors(self, q: Floats) -> Floats:
        """Error of the TCP (N, 3), mm, actual − nominal, at model angles q (N, n), rad: μ + σ wᵀe of each component."""
        standard = self.joints.standardised(np.asarray(q, float))
        own = [axis.predicted(standard * weights) for axis, weights in zip(self.axes, self.joint_weights, strict=True)]
        return self.scale.restored(np.stack(own, axis=-1))


def _covariance(a: Floats, b: Floats, reach: float) -> Floats:
    """C (A, B) = exp(−3‖a − b‖²/C_r²): σ² is 1 after standardising."""
    return np.asarray(np.exp(-3.0 * cdist(a, b, "sqeuclidean") / reach**2))
