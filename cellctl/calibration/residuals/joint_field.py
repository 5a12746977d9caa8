"""The anisotropic field: a Gaussian process on each axis, with a length of each joint that the rows determine.

**Model.** On each axis of the base the errors e (N,) that the other terms leave are

    e ~ N(0, C),    C = K + V + s² I,    K_nm = a² exp(−½ Σ_j (q_nj − q_mj)²/ℓ_j²),

ℓ_j the length of joint j, a the amplitude, s the nugget (noise, and what changes faster than ℓ). V is the covariance
J C_θ Jᵀ of what the other terms may still explain of e, by their own priors: without it the process would be given
what a fit of the links takes over afterwards.

**Hyper-parameters.** They maximise the logarithm of the marginal likelihood plus that of log-normal priors. With α =
C⁻¹e

    ln p = −½ eᵀα − ½ ln|C| − ½ N ln 2π,    ∂ln p/∂h = ½ tr((ααᵀ − C⁻¹) ∂C/∂h)

(Rasmussen and Williams 2006, Gaussian Processes for Machine Learning, eq. 5.8 and 5.9). All h are logarithms, so each
parameter is positive and its prior is normal. With M = (ααᵀ − C⁻¹) ∘ K and z = q/ℓ

    ∂/∂ln ℓ_j = Σ_n z²_nj Σ_m M_nm − Σ_n z_nj (M z)_nj,    ∂/∂ln a = Σ_nm M_nm,    ∂/∂ln s = s² (αᵀα − tr C⁻¹):

two matrix products for all joints, without an array for each. L-BFGS-B climbs from the medians of the priors.

**Then** it is an effect: expanded at M centres in z, where its kernel is the isotropic one of `PostureBasis` with ℓ =
1, its amounts are estimated together with the links (decision 36).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar, Self, final

import numpy as np
from scipy.linalg.blas import dsymv
from scipy.linalg.lapack import dpotrf, dpotri

from cellctl.calibration.model.effect import EffectInputs, OnlineTerms
from cellctl.calibration.model.parameter import MM, Group, Parameter, Phrase
from cellctl.calibration.model.postures import Postures
from cellctl.calibration.model.residual_model import PostureBasis, Remainder, ResidualModel, spread
from cellctl.kinematics import Floats, SerialChain

FTOL = 1e-10
"""L-BFGS-B ends at a relative change of the likelihood below this."""

GTOL = 1e-5
"""The same for its greatest derivative, nats per factor e."""

ITERATIONS = 200
"""Bound of a search that ends after some tens: without it one that alternates would not end."""

LOG_NO_PROCESS = -20.0
"""Logarithm of an amplitude in mm, e⁻²⁰ = 2e-9: K is far below any nugget, and C has no process."""

NUGGETS = 8
"""So many are tried in place of a process, from s to √(s² + a²), where all of it is noise. A step of the grid is at
most a factor of (1 + a²/s²)^(1/14)."""


@final
@dataclass(frozen=True, slots=True)
class LogNormal:
    """Log-normal prior of a positive number: median, 1 σ of its natural logarithm, and bounds of the search."""

    median: float
    sigma: float
    low: float
    high: float

    def scaled(self, unit: float) -> Self:
        """The same of a number in other units: all but σ times `unit`."""
        return type(self)(self.median * unit, self.sigma, self.low * unit, self.high * unit)


LENGTH_RAD = LogNormal(2.0, 1.0, 0.3, 30.0)
"""Errors of weight and geometry change over some tens of degrees of a joint; 1 σ is a factor e. The longest one, five
turns, is no influence at all; a shorter one than 0.3 (17°) would need more postures than anybody measures."""

AMPLITUDE = LogNormal(1.0, 1.5, 1e-2, 30.0)
NUGGET = LogNormal(0.1, 2.0, 1e-3, 3.0)
"""Both in standard deviations of the errors, for errors of any size (error maps): 1 σ a factor of 4 and 7, so wide that
the rows decide."""


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
        from scipy.optimize import minimize  # at first use: it takes 0.2 s

        each = [*[priors.length] * q.shape[1], priors.amplitude, priors.nugget]
        medians, sigmas = np.log([one.median for one in each]), np.array([one.sigma for one in each])
        bounds = [(float(np.log(one.low)), float(np.log(one.high))) for one in each]

        def negative_log_posterior(logs: Floats) -> tuple[float, Floats]:
            value, slopes = likelihood(logs, q, errors, known)
            away = (logs - medians) / sigmas
            return 0.5 * float(away @ away) - value, away / sigmas - slopes

        found = minimize(
            negative_log_posterior,
            medians,
            jac=True,
            bounds=bounds,
            method="L-BFGS-B",
            options={"ftol": FTOL, "gtol": GTOL, "maxiter": ITERATIONS},
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
        alone = (
            likelihood(np.array([*lengths, LOG_NO_PROCESS, np.log(each)]), q, errors, known)[0] for each in nuggets
        )
        return self.log_likelihood - max(alone)


def likelihood(logs: Floats, q: Floats, errors: Floats, known: Floats | None = None) -> tuple[float, Floats]:
    """Logarithm of the marginal likelihood of errors (N,) at q (N, n), and its derivatives (n + 2,) by the logarithms
    of lengths, amplitude and nugget.
    """
    count = len(q)
    scaled = q * np.exp(-logs[:-2])
    kernel = np.exp(2.0 * logs[-2]) * np.exp(-0.5 * _squared_distances(scaled, scaled))
    covariance = kernel if known is None else kernel + known
    # 1e-12 a²: repeated postures make K singular, and the nugget may be a millionth of a
    covariance = covariance + (np.exp(2.0 * logs[-1]) + 1e-12 * np.exp(2.0 * logs[-2])) * np.eye(count)
    root, failed = dpotrf(covariance.T, lower=1, overwrite_a=1)
    if failed:  # not positive definite by rounding: the line search steps back from here
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


ROWS_AT_LEAST = 30
"""Fewer rows do not determine a length of each of six or seven joints, an amplitude and a nugget on each axis."""

CENTRES = 128
"""Twice as many as a discrepancy has: along some joints its length may be short."""

PRIORS = Priors(LENGTH_RAD, LogNormal(0.1, 1.5, 1e-3, 3.0), LogNormal(0.05, 2.0, 1e-3, 3.0))
"""Amplitude and nugget, mm, of what geometry and effects leave: see `discrepancy.EXPECTED_MM`."""

SHOWN = 1.0
"""Nats for each hyper-parameter by which all axes together have to raise the marginal likelihood (Akaike):
n lengths and an amplitude for each axis; both models have a nugget. Without a process its lengths mean nothing, so no
χ² holds here: held-out rows decide."""

_PHRASE = Phrase("field", "field")


@final
@dataclass(frozen=True, eq=False)
class JointField(ResidualModel):
    """A Gaussian process on each axis of the robot's base frame, squared exponential in the joint angles.

    centres (M, n): postures, rad, at which it is expanded. lengths (3, n): for x, y, z the difference of each joint,
    rad, at which two postures share 60 % of it. expected (3,): 1 σ of each axis, mm. All are found by marginal
    likelihood (`fitted_to`), so that nothing scales them again. The part that the centres do not span is not predicted:
    it belongs to the uncertainty (`variance`).
    """

    centres: Floats
    lengths: Floats
    expected: tuple[float, ...]
    bases: tuple[PostureBasis, ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if self.lengths.shape != (3, self.centres.shape[1]) or len(self.expected) != 3:
            raise ValueError("a field has three rows of lengths, one of each joint, and three expected sizes")
        if not (self.lengths > 0.0).all():
            raise ValueError("the lengths of a field are above 0")
        object.__setattr__(self, "bases", tuple(PostureBasis(self.centres / own, 1.0) for own in self.lengths))

    group: ClassVar[Group] = "field"
    title: ClassVar[str] = "Field"
    chosen: ClassVar = "by held-out rows"
    prior_scales: ClassVar = None

    @classmethod
    def of_inputs(cls, setup: EffectInputs) -> Self | None:
        """Over the postures of the rows, with the same length for every joint until `fitted_to` sets them."""
        if len(setup.at.q) < ROWS_AT_LEAST:
            return None
        lengths = np.full((3, setup.at.q.shape[1]), LENGTH_RAD.median)
        return cls._over(setup.at.q, lengths, (PRIORS.amplitude.median,) * 3)

    def fitted_to(self, left: Remainder) -> Self | None:
        """With the lengths and sizes of greatest marginal likelihood; None where no axis is more probable with it."""
        if len(left.q) < ROWS_AT_LEAST:
            return None
        axes = [
            AxisProcess.fitted(left.q, errors, PRIORS, known)
            for errors, known in zip(left.errors.T, left.known, strict=True)
        ]
        pairs = zip(axes, left.errors.T, left.known, strict=True)
        gain = sum(axis.gain(left.q, errors, known) for axis, errors, known in pairs)
        if gain < SHOWN * 3 * (left.q.shape[1] + 1):
            return None
        return self._over(left.q, np.stack([axis.lengths for axis in axes]), tuple(axis.amplitude for axis in axes))

    @classmethod
    def _over(cls, q: Floats, lengths: Floats, expected: tuple[float, ...]) -> Self:
        usual = np.exp(np.log(lengths).mean(axis=0))
        return cls(spread(q / usual, CENTRES) * usual, lengths, expected)

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """Three for each centre, mm."""
        return tuple(
            Parameter(f"field{m + 1}_{axis}", MM, self.group, f"field{m + 1} {axis.upper()}", _PHRASE)
            for m in range(len(self.centres))
            for axis in "xyz"
        )

    @property
    def sigma(self) -> Floats:
        """Prior 1 σ about 0, mm."""
        return np.tile(np.array(self.expected), len(self.centres))

    def suits(self, joints: int) -> bool:
        """Whether its postures are those of so many joints."""
        return bool(self.centres.shape[1] == joints)

    def shifts(self, nominal: SerialChain, at: Postures) -> Floats:
        """Ψ (N, 3, 3M): φ of each centre, on each axis."""
        result = np.zeros((len(at), 3, len(self.centres), 3))
        for axis, (basis, lengths) in enumerate(zip(self.bases, self.lengths, strict=True)):
            result[:, axis, :, axis] = basis.values(at.q / lengths)
        return result.reshape(len(at), 3, 3 * len(self.centres))

    def variance(self, nominal: SerialChain, at: Postures) -> Floats:
        """Variance that the centres leave at each posture (N,), mm², mean of the axes: far away all of it."""
        pairs = zip(self.expected, self.bases, self.lengths, strict=True)
        left = [size**2 * basis.remainder(at.q / lengths) for size, basis, lengths in pairs]
        return np.asarray(np.mean(left, axis=0))

    def add_online(self, amounts: Floats, terms: OnlineTerms) -> None:
        """A squared exponential about each centre, for each axis with its own lengths."""
        for axis, (basis, lengths) in enumerate(zip(self.bases, self.lengths, strict=True)):
            weights = np.zeros((len(self.centres), 3))
            weights[:, axis] = basis.kernel_weights(amounts.reshape(-1, 3)[:, axis])
            terms.nodes.append((basis.centres, np.tile(1.0 / lengths, (len(self.centres), 1)), weights))
