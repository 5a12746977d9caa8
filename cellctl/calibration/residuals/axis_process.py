"""A Gaussian process over the joints for one axis: lengths, amplitude and nugget by marginal likelihood.

Kernel: a² exp(−½ Σ_j (q_j − q'_j)²/ℓ_j²), and the nugget s² for each row. The logarithm of the marginal likelihood and
its gradient are closed forms (Rasmussen and Williams 2006, Gaussian Processes for Machine Learning, eq. 5.8 and 5.9).
With M = (ααᵀ − C⁻¹) ∘ K the derivative by log ℓ_j is Σ_n z²_nj Σ_m M_nm − Σ_n z_nj (M z)_nj, z = q/ℓ: two matrix
products for all joints, without an array for each.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self, final

import numpy as np
from scipy.linalg.blas import dsymv
from scipy.linalg.lapack import dpotrf, dpotri
from scipy.optimize import minimize

from cellctl.kinematics import Floats

SHARP = 1e-10
"""The search ends at a relative change of the likelihood below this."""

GRADIENT = 1e-5
"""The same for its greatest derivative."""

ITERATIONS = 200

NOTHING = -20.0
"""Logarithm of an amplitude that changes nothing, mm."""

NUGGETS = 8
"""So many are tried in place of a process."""


@final
@dataclass(frozen=True, slots=True)
class LogNormal:
    """What is known of a positive number beforehand: median, 1 σ of its natural logarithm, and bounds."""

    median: float
    sigma: float
    low: float
    high: float

    def scaled(self, unit: float) -> Self:
        """The same of a number in other units: all but σ times `unit`."""
        return type(self)(self.median * unit, self.sigma, self.low * unit, self.high * unit)


LENGTH_RAD = LogNormal(2.0, 1.0, 0.3, 30.0)
"""Errors of weight and geometry change over some tens of degrees of a joint. The longest one is no influence at all."""

AMPLITUDE = LogNormal(1.0, 1.5, 1e-2, 30.0)
NUGGET = LogNormal(0.1, 2.0, 1e-3, 3.0)
"""Both in standard deviations of the errors."""


@final
@dataclass(frozen=True, slots=True)
class Priors:
    """Priors of length (of each joint, rad), amplitude and nugget (mm)."""

    length: LogNormal = LENGTH_RAD
    amplitude: LogNormal = AMPLITUDE
    nugget: LogNormal = NUGGET

    def of_errors(self, scatter: float) -> Self:
        """With amplitude and nugget in standard deviations of errors, for errors that scatter by so many mm."""
        return type(self)(self.length, self.amplitude.scaled(scatter), self.nugget.scaled(scatter))


@final
@dataclass(frozen=True, eq=False)
class AxisProcess:
    """Hyper-parameters: lengths (n,), rad; amplitude and nugget, mm. log_likelihood: of the rows that determined them,
    without the priors'.
    """

    lengths: Floats
    amplitude: float
    nugget: float
    log_likelihood: float

    @classmethod
    def fitted(cls, q: Floats, errors: Floats, priors: Priors, known: Floats | None = None) -> Self:
        """The most probable ones for errors (N,), mm, at angles q (N, n), rad.

        known (N, N): covariance, mm², of what other terms of a model may explain of these errors; none where absent.
        """
        each = [*[priors.length] * q.shape[1], priors.amplitude, priors.nugget]
        medians, sigmas = np.log([one.median for one in each]), np.array([one.sigma for one in each])
        bounds = [(float(np.log(one.low)), float(np.log(one.high))) for one in each]

        def improbable(logs: Floats) -> tuple[float, Floats]:
            value, slopes = likelihood(logs, q, errors, known)
            away = (logs - medians) / sigmas
            return 0.5 * float(away @ away) - value, away / sigmas - slopes

        found = minimize(
            improbable,
            medians,
            jac=True,
            bounds=bounds,
            method="L-BFGS-B",
            options={"ftol": SHARP, "gtol": GRADIENT, "maxiter": ITERATIONS},
        )
        values = np.exp(found.x)
        best = likelihood(found.x, q, errors, known)[0]
        return cls(values[:-2], float(values[-2]), float(values[-1]), best)

    def kernel(self, a: Floats, b: Floats) -> Floats:
        """Covariance (A, B), mm², of the process between postures a (A, n) and b (B, n), rad; without the nugget."""
        return np.asarray(self.amplitude**2 * np.exp(-0.5 * _squared_distances(a / self.lengths, b / self.lengths)))

    def gain(self, q: Floats, errors: Floats, known: Floats | None = None) -> float:
        """Rise of the logarithm of the marginal likelihood by the process, compared with the best nugget alone."""
        lengths = np.log(self.lengths)
        nuggets = np.geomspace(self.nugget, np.hypot(self.nugget, self.amplitude), NUGGETS)
        alone = (likelihood(np.array([*lengths, NOTHING, np.log(each)]), q, errors, known)[0] for each in nuggets)
        return self.log_likelihood - max(alone)


def likelihood(logs: Floats, q: Floats, errors: Floats, known: Floats | None = None) -> tuple[float, Floats]:
    """Logarithm of the marginal likelihood of errors (N,) at q (N, n), and its derivatives (n + 2,) by the logarithms
    of lengths, amplitude and nugget.
    """
    count = len(q)
    scaled = q * np.exp(-logs[:-2])
    kernel = np.exp(2.0 * logs[-2]) * np.exp(-0.5 * _squared_distances(scaled, scaled))
    covariance = kernel if known is None else kernel + known
    covariance = covariance + (np.exp(2.0 * logs[-1]) + 1e-12 * np.exp(2.0 * logs[-2])) * np.eye(count)
    root, failed = dpotrf(covariance.T, lower=1, overwrite_a=1)
    if failed:
        return -1e12, np.zeros_like(logs)
    half = float(np.sum(np.log(np.diag(root))))
    inverse, _ = dpotri(root, lower=1, overwrite_c=1)
    pull = dsymv(1.0, inverse, errors, lower=1)
    trace = float(np.trace(inverse))
    inverse = np.tril(inverse) + np.tril(inverse, -1).T
    weight = (np.outer(pull, pull) - inverse) * kernel
    of_lengths = weight.sum(axis=1) @ scaled**2 - np.sum(scaled * (weight @ scaled), axis=0)
    of_nugget = np.exp(2.0 * logs[-1]) * (float(pull @ pull) - trace)
    value = -0.5 * float(errors @ pull) - half - 0.5 * count * np.log(2.0 * np.pi)
    return value, np.array([*of_lengths, float(weight.sum()), of_nugget])


def _squared_distances(a: Floats, b: Floats) -> Floats:
    """‖a_i − b_j‖² (A, B) of points (A, n) and (B, n)."""
    squares = np.sum(a**2, axis=1)[:, None] + np.sum(b**2, axis=1) - 2.0 * (a @ b.T)
    return np.asarray(np.maximum(squares, 0.0))
