"""The measured region of a model, and how much σ grows outside it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol, Self, final

import numpy as np

from cellctl.calibration.distributions import chi2_ppf, f_isf
from cellctl.calibration.model.postures import Postures
from cellctl.calibration.model.residual_model import PostureBasis, ResidualModel, left_among
from cellctl.kinematics import Floats

OUTSIDE = 0.5
"""A posture with more than this share of the variance left is outside."""


def radius_95(degrees_of_freedom: float = np.inf) -> float:
    """95 % radius over the 3-D RMS σ of errors that are alike in all directions: √F₃,ν(0.95), 1.61 where ν is infinite.

    Errors whose σ is known within a factor (ν times its inverse square is χ²_ν) have a multivariate t distribution.
    """
    if np.isinf(degrees_of_freedom):
        return float(np.sqrt(chi2_ppf(0.95, 3) / 3.0))
    return float(np.sqrt(f_isf(0.05, 3, degrees_of_freedom)))


class Coverage(Protocol):
    """Remaining variance at other postures: a `PostureBasis`, or its equivalent from an old model file."""

    def joined(self, q: Floats) -> tuple[Self, float]:
        """With postures q (N, n), rad, added; and the share left at one of all these that is left out."""
        ...

    def remainder(self, q: Floats) -> Floats:
        """The share (N,) of the variance of a smooth error that is left at q (N, n), rad."""
        ...


@final
@dataclass(frozen=True, eq=False)
class MeasuredRegion:
    """The postures of the rows that determined a model's own parameters, and how much σ grows outside them.

    lower, upper (n,): least and greatest model angles, rad. coverage: gives the share of the variance of a smooth
    error that these postures leave at another one: the measure of how far it is outside. within: that share at one
    of the rows that is left out (95 % have less), whose error their noise already includes. outside_mm: 1 σ, 3-D,
    mm, of a prediction where all of that variance is left. scatter_mm: scatter of the rows beyond their stated σ, 1
    σ, 3-D, mm: errors of the robot that change too fast for the model. residual_models: those of the model; the one
    with the larger share outside counts. model_error_scale: factor on the whole σ of a prediction
    (`RowsAtJoints.model_error_scale`); 1 where the rows show no model error, or an instrument measured some.
    degrees_of_freedom: of that σ; infinite where the rows show no model error, or an instrument measured some.
    """

    lower: Floats
    upper: Floats
    outside_mm: float
    coverage: Coverage
    within: float = 0.0
    scatter_mm: float = 0.0
    residual_models: tuple[ResidualModel, ...] = ()
    model_error_scale: float = 1.0
    degrees_of_freedom: float = np.inf

    @classmethod
    def of(
        cls,
        angles: Floats,
        outside_mm: float = 0.0,
        scatter_mm: float = 0.0,
        residual_models: tuple[ResidualModel, ...] = (),
    ) -> Self:
        """The region of rows at angles (N, n), rad."""
        basis, within = PostureBasis.over(angles), left_among(angles)
        return cls(angles.min(axis=0), angles.max(axis=0), outside_mm, basis, within, scatter_mm, residual_models)

    def with_angles(self, angles: Floats) -> Self:
        """The region of this one and of rows at angles (N, n), rad."""
        lower, upper = np.minimum(self.lower, angles.min(axis=0)), np.maximum(self.upper, angles.max(axis=0))
        coverage, within = self.coverage.joined(angles)
        return replace(self, lower=lower, upper=upper, coverage=coverage, within=within)

    @property
    def radius_95(self) -> float:
        """95 % radius of a predicted place over its σ, 3-D, if its errors are alike in all directions."""
        return radius_95(self.degrees_of_freedom)

    def sigma(self, q: Floats) -> Floats:
        """1 σ (N,), 3-D, mm, of a prediction at angles q (N, n), rad, besides the model's own."""
        return np.asarray(np.hypot(self.scatter_mm, self.outside(q)))

    def outside(self, q: Floats) -> Floats:
        """The part of `sigma` (N,) that grows with the distance from the rows: o √((ρ − w)/(1 − w)), ρ the share left,
        w `within`: 0 among the rows, o far from all.
        """
        beyond = np.maximum(self.coverage.remainder(q) - self.within, 0.0) / (1.0 - self.within)
        own = [each.outside(Postures(q)) for each in self.residual_models]
        return np.asarray(self.outside_mm * np.sqrt(np.max([beyond, *own], axis=0)))
