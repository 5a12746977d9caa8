"""Whether two calibrations of one robot agree, by their own covariances.

**Difference.** Both predict the places of one TCP, with their own bases and tools left out: the best rigid motion, and
the slide of a tool, are projected out of the difference d = b − a (3N). With δ = θ_b − θ_a the parameters of the arm,
d = J δ, and V the covariance of δ (`difference_covariance`): C_a + C_b, less what the common prior correlates.

**Directions.** With the prior P, J P^½ = Q s Wᵀ (singular values); z = Qᵀd / s has unit variance before any row. The
eigenvectors of Z_a + Z_b (covariances of z after the rows) with an eigenvalue below `DETERMINED` are the directions
that *both* rows determined. In these, with E,

    M = zᵀE (Eᵀ Z_V E)⁻¹ Eᵀz / k,

the mean squared Mahalanobis distance per degree of freedom: 1 where both σ are right, less where a σ is too large. It
is judged by 0.6 … 1.6, or by the 99 % range of χ²_k / k where k is so small that this is wider.

**Scale.** An instrument's wrong scale stretches all places alike, and is one direction of k. It is tested by itself:
the factor that stretches a onto b by generalised least squares, with its σ.

**Places.** The normalised error of a place is the length of its d (in these directions) over its 95 % radius, 1.61 ×
the 3-D RMS σ (ISO 13528's E_n in three dimensions; √χ²_3(0.95)/√3 = 1.61).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal, Self, TypeAlias, final

import numpy as np

from cellctl.calibration.distributions import chi2_ppf
from cellctl.calibration.effects import functions, kinds
from cellctl.calibration.model.parameter import FRAMES, Parameter
from cellctl.calibration.model.robot_model import RobotModel
from cellctl.calibration.problem.measured_region import radius_95
from cellctl.kinematics import Floats

AgreementVerdict: TypeAlias = Literal["agree", "disagree", "not known"]

DETERMINED = 0.81
"""Of the sum of both variances after the rows, over that before: each σ fell by 10 % at least."""

SHARE = 0.9
"""Of the places within their 95 % radius. Errors of places are correlated: in one comparison of two right calibrations
fewer than 95 % may be."""

DISTANCES = (0.6, 1.6)
"""Of M; the lower one: beyond it a σ is too large for the agreement to say anything."""

LEVEL = 0.005
"""Of each side of the range of χ²_k / k."""

SCALE_SIGMAS = 4.0
"""A difference of scale beyond this is a disagreement. By chance 0.006 % are, but σ has no errors that the models lack:
in the simulated cell −68 ± 21 ppm were found without a fault."""

DIRECTIONS_AT_LEAST = 6
"""With fewer, hardly anything of the arm was determined twice."""


@final
@dataclass(frozen=True, eq=False)
class Calibration:
    """An identified robot: its model, covariance (P, P) after the rows, and variances (P,) before them (0: held)."""

    model: RobotModel
    covariance: Floats
    prior: Floats

    def bare(self, tool: Floats) -> RobotModel:
        """The arm alone, with `tool` (4, 4) on its flange: nominal base, no effect of its own tool."""
        of_own = [_of_set_up(each) for each in self.model.parameters]
        return self.model.on(np.eye(4), tool).with_deviations(np.where(of_own, 0.0, self.model.deviations))


@final
@dataclass(frozen=True, slots=True)
class AgreementFigures:
    """In the directions that both determined. within: share of the places whose normalised error is at most 1;
    error_rms, error_max: normalised errors. difference_rms_mm, sigma_rms_mm: of the places, 3-D. distance: M; limits:
    of M. scale_ppm, scale_sigma_ppm: by which b is larger than a.
    """

    within: float
    error_rms: float
    error_max: float
    difference_rms_mm: float
    sigma_rms_mm: float
    distance: float
    limits: tuple[float, float]
    scale_ppm: float
    scale_sigma_ppm: float


@final
@dataclass(frozen=True, slots=True)
class Agreement:
    """Two calibrations a and b of one robot. sentence: the verdict with its reason. places: their number;
    whole_rms_mm: difference there, RMS, 3-D, in all directions. degrees_of_freedom: k. not_determined: labels of the
    parameters that are visible at the places, and that not both determined. figures: None where k is too small.
    """

    verdict: AgreementVerdict
    sentence: str
    places: int
    whole_rms_mm: float
    degrees_of_freedom: int
    not_determined: tuple[str, ...]
    figures: AgreementFigures | None


@final
@dataclass(frozen=True, eq=False)
class _Differences:
    """Both calibrations in one order of parameters; named (P,): not coefficients of a random function. d (3N,);
    stretch (3N,): of the places by a factor, per unit; columns (3N, P); cov_a, cov_b, difference (P, P); prior
    (P,); open_a, open_b (N,): variances on each axis that random functions leave.
    """

    labels: tuple[str, ...]
    named: Any
    d: Floats
    stretch: Floats
    columns: Floats
    cov_a: Floats
    cov_b: Floats
    difference: Floats
    prior: Floats
    open_variance: Floats

    @classmethod
    def of(cls, a: Calibration, b: Calibration, q: Floats, tool: Floats) -> Self:
        models, own = (a.bare(tool), b.bare(tool)), functions()
        places: dict[tuple[str, str], tuple[str, list[tuple[int, int]]]] = {}
        for side, each in enumerate((a, b)):
            for at, parameter in enumerate(each.model.parameters):
                if _of_set_up(parameter) or each.prior[at] <= 0.0:
                    continue
                # a random function is one of its own rows: equal names are not equal amounts
                key = (parameter.name, str(side) if parameter.group in own else "")
                places.setdefault(key, (parameter.label, []))[1].append((side, at))
        jacobians = [model.jacobian(q)[:, :3].reshape(3 * len(q), -1) for model in models]
        count = len(places)
        columns = np.zeros((3 * len(q), count))
        indices = [np.full(count, -1), np.full(count, -1)]
        for place, (_, sides) in enumerate(places.values()):
            columns[:, place] = np.mean([jacobians[side][:, at] for side, at in sides], axis=0)
            for side, at in sides:
                indices[side][place] = at
        (cov_a, prior_a), (cov_b, prior_b) = (_ordered(*pair) for pair in zip((a, b), indices, strict=True))
        names = models[0].names
        slides = jacobians[0][:, [names.index(f"tool_{axis}") for axis in "xyz"]]
        points = models[0].tcp(q)
        nuisance, _ = np.linalg.qr(np.column_stack([_rigid_motions(points), slides]))
        stretch = (points - points.mean(axis=0)).reshape(-1)
        d = (models[1].tcp(q) - models[0].tcp(q)).reshape(-1)
        return cls(
            labels=tuple(label for label, _ in places.values()),
            named=np.array([not side for _, side in places], bool),
            stretch=stretch - nuisance @ (nuisance.T @ stretch),
            d=d - nuisance @ (nuisance.T @ d),
            columns=columns - nuisance @ (nuisance.T @ columns),
            cov_a=cov_a,
            cov_b=cov_b,
            difference=difference_covariance(cov_a, prior_a, cov_b, prior_b),
            prior=np.maximum(prior_a, prior_b),
            open_variance=a.model.open_variance(q) + b.model.open_variance(q),
        )


def agreement(a: Calibration, b: Calibration, q: Floats, tool: Floats) -> Agreement:
    """Compare two calibrations of one nominal robot at model angles q (N, n), rad, with `tool` (4, 4) on the flange.

    Both have to be independent: rows that are in both, or a prior model of one in the other, correlate them.
    """
    found = _Differences.of(a, b, q, tool)
    rows, values, _ = np.linalg.svd(found.columns * np.sqrt(found.prior), full_matrices=False)
    seen = values > 1e-6 * max(float(values.max(initial=0.0)), 1e-12)
    rows, values = rows[:, seen], values[seen]
    to_z = rows.T / values[:, None]
    z, parameters = to_z @ found.d, to_z @ found.columns
    opened = (to_z * np.repeat(found.open_variance, 3)) @ to_z.T

    def in_z(covariance: Floats) -> Floats:
        return np.asarray(parameters @ covariance @ parameters.T)

    left, vectors = np.linalg.eigh(in_z(found.cov_a) + in_z(found.cov_b) + opened)
    both = vectors[:, left < DETERMINED]
    names = _not_determined(found, parameters, both)
    whole = float(np.sqrt(np.sum(found.d**2) / len(q)))
    count = both.shape[1]
    result = Agreement("not known", "", len(q), whole, count, names, None)
    if count < DIRECTIONS_AT_LEAST:
        why = f"both determined only {count} directions of the arm, and {DIRECTIONS_AT_LEAST} are needed"
        return replace(result, sentence=_sentence("not known", why))
    variance = both.T @ (in_z(found.difference) + opened) @ both
    at, stretched = both.T @ z, both.T @ (to_z @ found.stretch)
    weighed = np.linalg.solve(variance, stretched)
    scale_sigma = 1.0 / float(np.sqrt(max(stretched @ weighed, 1e-300)))
    back = (rows * values) @ both
    away = np.linalg.norm((back @ at).reshape(-1, 3), axis=1)
    sigma = np.sqrt(np.sum((back @ variance) * back, axis=1).reshape(-1, 3).sum(axis=1))
    errors = away / (radius_95() * sigma)
    figures = AgreementFigures(
        within=float(np.mean(errors <= 1.0)),
        error_rms=_rms(errors),
        error_max=float(errors.max()),
        difference_rms_mm=_rms(away),
        sigma_rms_mm=_rms(sigma),
        distance=float(at @ np.linalg.solve(variance, at)) / count,
        limits=_limits(count),
        scale_ppm=1e6 * float(weighed @ at) * scale_sigma**2,
        scale_sigma_ppm=1e6 * scale_sigma,
    )
    verdict, reason = _judged(figures, len(q), count)
    return replace(result, verdict=verdict, sentence=_sentence(verdict, reason), figures=figures)


def difference_covariance(cov_a: Floats, prior_a: Floats, cov_b: Floats, prior_b: Floats) -> Floats:
    """Covariance (P, P) of the difference of two fits of an unchanged robot, which start from the same prior.

    For true deviations θ ~ N(0, P) a fit's result is m = θ − (1 − S) θ + noise, with 1 − S = C P⁻¹ (C: covariance after
    the rows), and the noise has the covariance C − C P⁻¹ C. So

        V = (C_a − C_a P_a⁻¹ C_a) + (C_b − C_b P_b⁻¹ C_b) + (S_a − S_b) P (S_a − S_b)ᵀ,

    C_a + C_b where the rows determine everything, and 0 where they determine nothing.
    cov_a, cov_b (P, P): after the rows; prior_a, prior_b (P,): variances before them, 0 for a parameter that is held.
    """
    weight_a, weight_b = (
        np.divide(1.0, prior, out=np.zeros_like(prior), where=prior > 0) for prior in (prior_a, prior_b)
    )
    noise = cov_a - cov_a * weight_a @ cov_a + cov_b - cov_b * weight_b @ cov_b
    shrunk = cov_a * weight_a - cov_b * weight_b
    found: Floats = noise + shrunk * np.maximum(prior_a, prior_b) @ shrunk.T
    return found


def _of_set_up(parameter: Parameter) -> bool:
    """Whether a parameter is of base or tool, or of an effect of a touching tool."""
    kind = kinds().get(parameter.group)
    return parameter.group in FRAMES or (kind is not None and kind.of_touches)


def _judged(found: AgreementFigures, places: int, freedom: int) -> tuple[AgreementVerdict, str]:
    lower, upper = found.limits
    share = f"{100.0 * found.within:.0f} % of {places} places are within the 95 % radius"
    distance = f"the mean squared Mahalanobis distance is {found.distance:.2f} per degree of freedom ({freedom})"
    if found.distance > upper:
        return "disagree", f"{distance}, above {upper:.2f}, and {share}"
    if abs(found.scale_ppm) > SCALE_SIGMAS * found.scale_sigma_ppm:
        scale = f"b is larger than a by {found.scale_ppm:.0f} ± {found.scale_sigma_ppm:.0f} ppm (1 σ)"
        return "disagree", f"{scale}; check the instrument's scale and the certified distances"
    if found.distance < lower:
        return "not known", f"{distance}, below {lower:.2f}: a stated σ is too large to tell, and {share}"
    if found.within < SHARE:
        return "not known", f"{share}, fewer than {100.0 * SHARE:.0f} %, though {distance}"
    return "agree", f"{share}, and {distance}"


def _sentence(verdict: AgreementVerdict, reason: str) -> str:
    words = {"agree": "The calibrations agree", "disagree": "The calibrations disagree"}
    return f"{words.get(verdict, 'Whether the calibrations agree is not known')}: {reason}."


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _limits(count: int) -> tuple[float, float]:
    lower, upper = (float(chi2_ppf(p, count)) / count for p in (LEVEL, 1.0 - LEVEL))
    return min(DISTANCES[0], lower), max(DISTANCES[1], upper)


def _not_determined(found: _Differences, parameters: Floats, both: Floats) -> tuple[str, ...]:
    """Labels of parameters of which less than half of what is visible at the places was determined by both."""
    visible = parameters * np.sqrt(found.prior)
    whole = np.sum(visible**2, axis=0)
    share = np.divide(np.sum((both.T @ visible) ** 2, axis=0), whole, out=np.ones_like(whole), where=whole > 1e-9)
    hidden = (share < 0.5) & found.named
    return tuple(label for label, is_hidden in zip(found.labels, hidden, strict=True) if is_hidden)


def _ordered(each: Calibration, index: Any) -> tuple[Floats, Floats]:
    """Covariance (P, P) and prior variances (P,) in the order of `index` (P,), −1: it does not have the parameter."""
    here = np.flatnonzero(index >= 0)
    there = index[here]
    covariance, prior = np.zeros((len(index),) * 2), np.zeros(len(index))
    covariance[np.ix_(here, here)] = each.covariance[np.ix_(there, there)]
    prior[here] = each.prior[there]
    return covariance, prior


def _rigid_motions(points: Floats) -> Floats:
    """How points (N, 3) move under three slides, and three turns about their middle (3 N, 6), in their spread."""
    arms = points - points.mean(axis=0)
    arms = arms / max(float(np.abs(arms).max()), 1e-9)
    motions = [np.broadcast_to(axis, arms.shape) for axis in np.eye(3)] + [np.cross(axis, arms) for axis in np.eye(3)]
    return np.stack([motion.reshape(-1) for motion in motions], axis=1)
