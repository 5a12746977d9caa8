"""The anisotropic field as an error map: a Gaussian process on each axis, with a length of each joint.

The same process joins a robot's geometry in `cellctl fit --model auto`, as its discrepancy. Here it has the errors of
nominal alone: what to compare with other error maps.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Self, final

import numpy as np
from scipy.linalg import cho_solve, cholesky, solve_triangular

from cellctl.calibration.residuals.joint_field import AxisProcess, Priors
from cellctl.error_maps.samples import LEAST_SCATTER, checked
from cellctl.kinematics import Bools, Floats


@final
@dataclass(frozen=True, slots=True)
class AnisotropicField:
    """The method. priors: of the hyper-parameters; amplitude and nugget in standard deviations of the errors."""

    priors: Priors = field(default_factory=Priors)

    def fit(self, q: Floats, errors: Floats) -> FieldMap:
        """The map of errors (N, 3), mm, actual − nominal, at model angles q (N, n), rad.

        All hyper-parameters by marginal likelihood. Raises UnusableSamples (`samples.checked`). A joint that
        never moved has no influence. A constant error is predicted as such.
        """
        q, errors = checked(q, errors)
        moved = np.ptp(q, axis=0) >= LEAST_SCATTER
        axes = [_AxisMap.of(q[:, moved], own, self.priors) for own in errors.T]
        return FieldMap.of(moved, q[:, moved], axes)


@final
@dataclass(frozen=True, eq=False)
class _AxisMap:
    """One axis: mean, mm; hyper-parameters; lower root (N, N) of the covariance; pull (N,): C⁻¹ e."""

    mean: float
    process: AxisProcess
    root: Floats
    pull: Floats

    @classmethod
    def of(cls, q: Floats, errors: Floats, priors: Priors) -> Self:
        mean, scatter = float(errors.mean()), float(errors.std())
        if scatter < LEAST_SCATTER:
            nothing = AxisProcess(np.ones(q.shape[1]), 0.0, LEAST_SCATTER, 0.0)
            return cls(mean, nothing, LEAST_SCATTER * np.eye(len(q)), np.zeros(len(q)))
        process = AxisProcess.fitted(q, errors - mean, priors.of_errors(scatter))
        root = cholesky(process.kernel(q, q) + process.nugget**2 * np.eye(len(q)), lower=True)
        return cls(mean, process, root, cho_solve((root, True), errors - mean))


@final
@dataclass(frozen=True, eq=False)
class FieldMap:
    """A fitted field (`ErrorMap`). moved (n,): which joints moved; q (N, m): their angles, rad; axes: x, y, z."""

    moved: Bools
    q: Floats
    axes: tuple[_AxisMap, ...]
    _means: Floats = field(repr=False)
    _exponents: Floats = field(repr=False)
    _pulls: Floats = field(repr=False)

    @classmethod
    def of(cls, moved: Bools, q: Floats, axes: list[_AxisMap]) -> Self:
        """With what a single prediction needs, computed once: −½d² = E·(1, q, q²), a row of E for each row and axis."""
        exponents = []
        for axis in axes:
            weight = axis.process.lengths**-2.0
            constant = -0.5 * np.sum(q**2 * weight, axis=1, keepdims=True)
            exponents.append(np.hstack([constant, q * weight, np.tile(-0.5 * weight, (len(q), 1))]))
        pulls = np.stack([axis.process.amplitude**2 * axis.pull for axis in axes])
        means = np.array([axis.mean for axis in axes])
        return cls(moved, q, tuple(axes), means, np.vstack(exponents), pulls)

    @property
    def processes(self) -> tuple[AxisProcess, ...]:
        """Hyper-parameters of x, y, z; lengths of the joints that moved."""
        return tuple(axis.process for axis in self.axes)

    def error(self, q: Floats) -> Floats:
        """Error (3,), mm, at one posture (n,), rad: the fast way, for a controller's cycle."""
        at = q[self.moved]
        kernel = np.exp(self._exponents @ np.concatenate(([1.0], at, at * at)))
        return np.asarray(self._means + (self._pulls * kernel.reshape(self._pulls.shape)).sum(axis=1))

    def errors(self, q: Floats) -> Floats:
        """Error of the TCP (N, 3), mm, actual − nominal, at model angles q (N, n), rad."""
        at = np.asarray(q, float)[:, self.moved]
        return np.stack([axis.mean + axis.process.kernel(at, self.q) @ axis.pull for axis in self.axes], axis=-1)

    def sigma(self, q: Floats) -> Floats:
        """1 σ of each axis (N, 3), mm, of the error at q (N, n), rad, without the nugget, the scatter of a measurement.

        The hyper-parameters are taken as certain: from 80 rows of six joints σ is about 15 % low.
        """
        at = np.asarray(q, float)[:, self.moved]
        open_ = []
        for axis in self.axes:
            known = solve_triangular(axis.root, axis.process.kernel(at, self.q).T, lower=True, check_finite=False)
            open_.append(axis.process.amplitude**2 - np.sum(known**2, axis=0))
        return np.asarray(np.sqrt(np.maximum(np.stack(open_, axis=-1), 0.0)), float)
