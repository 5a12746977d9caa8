"""A figure of held-out errors with its expanded uncertainty, and the decision on its limit by ISO 14253-1.

The places count as drawn at random from those that the robot will go to. Let e_1 … e_n be the measured errors, mm, u_c
the standard uncertainty that all of them share (what scatter cannot show: scale and zero of the instrument, artefact,
temperature) and u_1 that of a single measured error, u_c included.

    mean        u² = s²/n + u_c²                  sample of places, scatter of the instrument, shared part
    95 %        u² = u_q² + u_c²                  the same; the errors' distribution is taken as a gamma distribution
    maximum     u = u_1                           of the greatest error at these places; other places are not in it

U = k u. For mean and 95 % quantile k is Student's factor of the effective degrees of freedom (Welch–Satterthwaite,
JCGM 100:2008, G.4); for the maximum that of a normal error along a line, or in space.

A gamma distribution has about the shape of lengths of normal errors along a line, in a plane and in space, and of such
with a heavier tail. From 20 errors its 95 % quantile lies beyond all but one of them, so u_q is enlarged by WIDER. The
noise of the measurement is in every e_i: mean and quantile are too large by it rather than too small.
What none of them contains: the model's error at other loads, temperatures and outside the measured joints.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal, final, get_args

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from cellctl.calibration.distributions import t_ppf
from cellctl.kinematics import Floats

Measurand = Literal["mean", "quantile_95", "maximum"]
MEASURANDS: Final[tuple[Measurand, ...]] = get_args(Measurand)

COVERAGE: Final = 0.95
"""Coverage probability of every U."""

LEAST: Final[dict[Measurand, int]] = {"mean": 2, "quantile_95": 20, "maximum": 1}
"""Errors that each measurand needs; a 95 % quantile of fewer than 20 is an extrapolation beyond all of them."""

WIDER: Final = 1.3
"""Factor of the jackknife's uncertainty of the 95 % quantile: alone it covers 84 to 94 % in place of 95 % (tests)."""

Word = Literal["accepted", "rejected", "no decision"]


@final
@dataclass(frozen=True, slots=True)
class MeasuredFigure:
    """A figure of n errors: its value, mm, standard uncertainty, mm, and coverage factor for COVERAGE.

    share_below: with 95 % confidence at least this share of such places has an error below the greatest of these n.
    """

    measurand: Measurand
    n: int
    value_mm: float
    standard_mm: float
    factor: float
    share_below: float

    @property
    def expanded_mm(self) -> float:
        """The expanded uncertainty U."""
        return self.factor * self.standard_mm


def measured_figure(
    measurand: Measurand, errors_mm: ArrayLike, *, shared_mm: float, single_mm: float, single_factor: float
) -> MeasuredFigure:
    """The figure of errors (N,), mm, 0 or greater.

    shared_mm: u_c; single_mm: u_1, both standard uncertainties; single_factor: the coverage factor of a single error.
    Raises ValueError for too few errors, or none above 0.
    """
    errors = np.asarray(errors_mm, float)
    least, n = LEAST[measurand], errors.size
    if n < least:
        raise ValueError(f"it needs {least} measured errors or more, and there are {n}")
    if not (np.isfinite(errors).all() and (errors >= 0.0).all() and errors.max() > 0.0):
        raise ValueError("errors are finite lengths, and not all of them zero")
    value, sampling, freedom = _SAMPLED[measurand](errors)
    standard, factor = float(np.hypot(sampling, shared_mm)), single_factor
    if measurand == "maximum":
        standard = single_mm
    elif sampling > 0.0:
        factor = float(t_ppf(0.5 + COVERAGE / 2.0, freedom * (standard / sampling) ** 4))
    return MeasuredFigure(measurand, n, value, standard, factor, float((1.0 - COVERAGE) ** (1.0 / n)))


def _mean(errors: Floats) -> tuple[float, float, int]:
    """Value, standard uncertainty by the sample of places, and its degrees of freedom."""
    n = len(errors)
    return float(errors.mean()), float(errors.std(ddof=1) / np.sqrt(n)), n - 1


def _maximum(errors: Floats) -> tuple[float, float, int]:
    return float(errors.max()), 0.0, 1


def _quantile(errors: Floats) -> tuple[float, float, int]:
    """By the moments of a gamma distribution, and the jackknife of its logarithm."""
    n = len(errors)
    value = float(_gamma_quantile(errors))
    without = np.log(_gamma_quantile(np.array([np.delete(errors, each) for each in range(n)])))
    return value, value * WIDER * float(np.sqrt((n - 1) * without.var())), n - 2


def _gamma_quantile(errors: Floats) -> Floats:
    """The quantile of errors (…, N): mean m, shape a = m²/variance, q = m P⁻¹(a, 0.95)/a."""
    mean, variance = errors.mean(axis=-1), errors.var(axis=-1, ddof=1)
    shape = mean**2 / np.maximum(variance, 1e-12 * mean**2)  # all errors alike: a narrow peak
    return np.asarray(mean * special.gammaincinv(shape, COVERAGE) / shape)


_SAMPLED = {"mean": _mean, "quantile_95": _quantile, "maximum": _maximum}


def decision(value_mm: float, guard_band_mm: float, limit_mm: float) -> Word:
    """ISO 14253-1: accepted if the value plus the guard band is within the limit, rejected if less it is beyond."""
    if value_mm + guard_band_mm <= limit_mm:
        return "accepted"
    return "rejected" if value_mm - guard_band_mm > limit_mm else "no decision"
