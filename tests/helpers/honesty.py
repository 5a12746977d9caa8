"""How honest an identification is about itself, judged by a truth that it does not know.

NEES: δᵀ C⁻¹ δ, the squared error in the fit's own standard deviations. Over k numbers it is χ² with k degrees of
freedom where C is right: its mean is k, and 95 % of all draws lie below the χ²'s quantile. *All* free parameters are in
it, the registered ones (base, tool, spheres' centres, with a flat prior) as well: the data determine these given the
rest, so their errors have the covariance that C says although no prior drew them; without them their correlations with
the others, which carry most of what a prediction says, would stay unproved.

`fitted` is the one place where the study meets cellctl: a draw in, what was identified out.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.stats import chi2

from cellctl.calibration import (
    Identification,
    MeasuredRegion,
    Observability,
    PoseRows,
    PositionRows,
    RobotModel,
    RowBlocks,
    SpacingRows,
    Split,
    Task,
    Tolerances,
    ToolDeflection,
    TouchRows,
    fit,
    identify,
    predict,
)
from cellctl.calibration.problem.measured_region import radius_95
from cellctl.calibration.rows.type_rows import TypePrior
from cellctl.calibration.verdict.reliability import Reliability
from cellctl.kinematics import Link, SerialChain
from tests.helpers.own_model import (
    Floats,
    OwnArm,
    OwnPoses,
    OwnPositions,
    OwnTouches,
    Unknown,
    deviations_between,
    scipys_optimum,
)
from tests.helpers.simulated_setups import Draw

TORCH_M = 0.4103
"""Length of the KR5's torch; with the weight, the horizontal torch's sag comes out as the own arm's."""

QUANTILE_DRAWS = 4000


@dataclass(frozen=True, eq=False)
class Fitted:
    """What cellctl identified. unknown: the parameters that it is unsure of, and where cellctl counts them from;
    found (F,), covariance (F, F). left_out: rows taken for outliers; growth: of σ; prior_scale: of
    which groups the tolerances grew, and by how much.
    """

    unknown: Unknown
    found: Floats
    covariance: Floats
    left_out: int
    growth: float
    converged: bool
    prior_scale: Mapping[str, float]
    identification: Identification
    task: Task

    @property
    def discrepant(self) -> bool:
        """Whether the rows showed that the model lacks something."""
        return any(name.startswith("discrepancy") for name in self.unknown.names)

    def columns(self, q: Floats) -> Floats:
        """How cellctl's tool centre points at q (N, n), rad, move with the free parameters (N, 3, F), mm per unit."""
        best = self.identification.identified
        whole = np.zeros((len(q), 3, len(best.unknowns.names)))
        whole[:, :, best.state.columns[0]] = best.state.model.jacobian(q)[:, :3]
        return whole[..., np.diag(best.covariance) > 0.0]

    @cached_property
    def region(self) -> MeasuredRegion:
        """What cellctl adds to its covariance."""
        return Reliability.of(self.task, self.identification).region

    def besides(self, q: Floats) -> Floats:
        """1 σ (N,) on each axis, mm, that cellctl adds to its covariance at q (N, n), rad."""
        return self.region.sigma(q) / np.sqrt(3.0)

    def predicted(self, q: Floats) -> tuple[Floats, Floats]:
        """Tool centre points (N, 3) and their 1 σ (N,), mm, as cellctl predicts them."""
        best = self.identification.identified
        robot = len(best.state.model.parameters)
        said = predict(best.state.model, best.covariance[:robot, :robot], q)
        return said.poses[:, :3, 3], said.sigma_mm


def fitted(draw: Draw, of_type: TypePrior | None = None) -> Fitted:
    """`draw`'s rows through `identify`, with the prior that its truth is from, and that of its type."""
    task = replace(task_of(draw), type_prior=of_type)
    done = identify(task)
    best = done.identified
    free = np.flatnonzero(np.diag(best.covariance) > 0.0)
    model, chain = best.state.model, best.state.model.chain
    start = replace(draw.nominal, base=np.array(chain.base), tool=np.array(chain.tool))
    names = tuple(best.unknowns.names[index] for index in free)
    unknown = Unknown(names, best.unknowns.sigma[free], start, draw.rough_centres)
    values = np.concatenate([model.deviations, (best.state.points - draw.rough_centres).ravel()])
    return Fitted(
        unknown=unknown,
        found=values[free],
        covariance=best.covariance[np.ix_(free, free)],
        left_out=len(done.outliers),
        growth=float(np.max(done.noise)),
        converged=best.converged,
        prior_scale=dict(done.prior_scale),
        identification=done,
        task=task,
    )


def observed(draw: Draw) -> Observability:
    """What a user is told that `draw`'s rows can see, and what not."""
    return fit(task_of(draw), Split(np.arange(len(draw.rows.q)), ())).observability


def task_of(draw: Draw) -> Task:
    """The task that a user would give."""
    nominal, bends = draw.nominal, "tool_deflection" in draw.free
    links = [
        Link(theta, d, a, alpha, beta if number in nominal.hayati else None)
        for number, (theta, d, a, alpha, beta) in enumerate(nominal.table.tolist(), start=1)
    ]
    chain = SerialChain.from_links("mdh-hayati", links, nominal.base, nominal.tool)
    prior = draw.told
    tolerances = Tolerances(
        link_mm=prior.link_mm,
        angle_deg=prior.angle_deg,
        joint_zero_deg=prior.joint_zero_deg,
        tool_mm=prior.tool_mm,
        flat_mm=prior.flat_mm,
        flat_rad=prior.flat_rad,
    )
    bend = ToolDeflection(TORCH_M, nominal.sag_mm * 3.0 / (1000.0 * TORCH_M**3), prior.deflection)
    model = RobotModel(chain, (bend,) if bends else ())
    match draw.rows:
        case OwnTouches() as rows:
            touches = TouchRows(rows.q, rows.sphere, np.full(len(rows.q), rows.reach), _all(rows.sigma_mm, rows.q, 1))
            pairs = OwnTouches.pairs(len(draw.centres))
            spacings = SpacingRows(pairs, rows.spacings, np.full((len(pairs), 1), rows.spacing_sigma_mm))
            names = tuple(f"S{number + 1}" for number in range(len(draw.centres)))
            return Task(model, RowBlocks.of(touches), names, draw.rough_centres, spacings, tolerances=tolerances)
        case OwnPoses() as rows:
            sigma = np.hstack([_all(rows.sigma_mm, rows.q, 3), _all(rows.sigma_rad, rows.q, 3)])
            return Task(model, RowBlocks.of(PoseRows(rows.q, rows.poses, sigma)), tolerances=tolerances)
        case OwnPositions() as rows:
            points = PositionRows(rows.q, rows.xyz, _all(rows.sigma_mm, rows.q, 3))
            return Task(model, RowBlocks.of(points), tolerances=tolerances)
        case _:
            raise TypeError(type(draw.rows))


def _all(sigma: float, q: Floats, count: int) -> Floats:
    return np.full((len(q), count), sigma)


@dataclass(frozen=True, eq=False)
class Honesty:
    """One draw's figures.

    nees, freedom: over all free parameters. inside: truth in their 95 % region. place_nees (M,), 3 degrees of freedom
    each: tool centre points where the robot is asked; place_inside: the first of them in its 95 % ellipsoid. rms,
    scipy_rms, said_rms: of the volumetric error over all of them, mm; volume_inside: rms² is below the 95 % quantile of
    what the fit's covariance says of it. off_scipy: greatest difference from SciPy's optimum in σ. strangest: greatest
    deviation found in σ of its prior, of what has one. left_out: of `rows` that were all clean; growth: of their σ;
    prior_scale: of the tolerances, by group. found_mm, stated_mm, among (M,), of `stated` ones: error and 1 σ of each
    place, and whether it is among the measured postures, where nothing is added for being outside. radius_95: of a
    place, over its σ.
    """

    nees: float
    freedom: int
    inside: bool
    place_nees: Floats
    place_inside: bool
    rms: float
    scipy_rms: float
    said_rms: float
    volume_inside: bool
    off_scipy: float
    strangest: float
    left_out: int
    rows: int
    growth: float
    prior_scale: Mapping[str, float]
    converged: bool
    found_mm: Floats = field(default_factory=lambda: np.zeros(0))
    stated_mm: Floats = field(default_factory=lambda: np.zeros(0))
    among: Floats = field(default_factory=lambda: np.zeros(0))
    radius_95: float = field(default_factory=radius_95)

    @property
    def places_inside(self) -> float:
        """Share of the places in their 95 % region, the ellipsoid of that radius."""
        return float(np.mean(self.place_nees <= 3.0 * self.radius_95**2))


def honesty(draw: Draw, *, compared: bool = True, stated: bool = False) -> Honesty:
    """Identify `draw` by cellctl and, where it is to be `compared`, by SciPy, and judge both by the truth.

    stated: by the σ that cellctl states of a prediction; else by the covariance of the fit, with what the measured
    region adds to a discrepancy. Places of touches are then judged without what moves all of them as one body.
    """
    fit = fitted(draw)
    names, start, arm = fit.unknown.names, fit.unknown.start, fit.unknown.arm(fit.found)
    truth = deviations_between(names, start, draw.truth, fit.unknown.centres, draw.centres)
    nees = squared(fit.found - truth, fit.covariance)
    if fit.discrepant:  # the own arm knows of none
        columns, points, besides = fit.columns(draw.asked), fit.predicted(draw.asked)[0], fit.besides(draw.asked)
    else:
        columns, points = fit.unknown.columns(fit.found, draw.asked), arm.points(draw.asked)
        besides = np.zeros(len(points))
    if stated:
        besides = fit.besides(draw.asked)
    error = points - draw.truth.points(draw.asked)
    each = zip(error, columns, besides, strict=True)
    places = np.array([squared(e, c @ fit.covariance @ c.T + s**2 * np.eye(3)) for e, c, s in each])
    volume = Volume.of(draw, arm, columns, fit.covariance, besides)
    each_place: dict[str, Any] = {}
    if stated:
        volume = replace(volume, factor=fit.region.model_error_scale * volume.factor)
        places = volume.squared(error)
        each_place = {
            "found_mm": np.linalg.norm(volume.shape_of(error), axis=1),
            "stated_mm": np.sqrt(np.sum(volume.factor.reshape(len(error), -1) ** 2, axis=1)),
            "among": (fit.region.outside(draw.asked) == 0.0).astype(float),
            "radius_95": fit.region.radius_95,
        }
    scipy_rms, off_scipy = _against_scipy(draw, fit, volume) if compared else (np.nan, np.nan)
    return Honesty(
        nees=nees,
        freedom=len(names),
        inside=bool(nees <= chi2.ppf(0.95, len(names))),
        place_nees=places,
        place_inside=bool(places[0] <= chi2.ppf(0.95, 3)),
        rms=volume.rms_of(error),
        scipy_rms=scipy_rms,
        said_rms=volume.said_rms,
        volume_inside=bool(volume.rms_of(error) ** 2 <= volume.quantile(0.95)),
        off_scipy=off_scipy,
        strangest=_strangest(draw, fit),
        left_out=fit.left_out,
        rows=len(draw.rows.q),
        growth=fit.growth,
        prior_scale=fit.prior_scale,
        converged=fit.converged,
        **each_place,
    )


def _against_scipy(draw: Draw, fit: Fitted, volume: Volume) -> tuple[float, float]:
    """Volumetric RMS of SciPy's optimum, mm, and the greatest difference of a parameter from it, σ."""
    own, found = own_optimum(draw)
    arm = own.arm(found)
    same = deviations_between(fit.unknown.names, fit.unknown.start, arm, fit.unknown.centres, own.centres_at(found))
    off = np.abs(fit.found - same) / np.sqrt(np.diag(fit.covariance))
    return volume.rms_of(arm.points(draw.asked) - draw.truth.points(draw.asked)), float(off.max())


def _strangest(draw: Draw, fit: Fitted) -> float:
    known = [index for index, name in enumerate(fit.unknown.names) if not name.startswith(draw.flat)]
    expected = np.array([draw.told.sigma(fit.unknown.names[index], draw.flat) for index in known])
    return float(np.max(np.abs(fit.found[known]) / expected))


@dataclass(frozen=True)
class Elsewhere:
    """Predictions at some angles: RMS of the error found and said, mm; NEES per degree of freedom; whether the first of
    them lies in its 95 % ellipsoid; whether the fit converged.
    """

    rms: float
    said_rms: float
    nees: float
    inside: bool
    converged: bool


def elsewhere(draw: Draw, others: Floats) -> tuple[Elsewhere, Elsewhere]:
    """How good predictions are at `draw.asked` and at `others` (M, n), where the fit saw nothing of the kind."""
    fit = fitted(draw)

    def at(q: Floats) -> Elsewhere:
        points, sigma = fit.predicted(q)
        error, columns = points - draw.truth.points(q), fit.unknown.columns(fit.found, q)
        places = [squared(e, c @ fit.covariance @ c.T) for e, c in zip(error, columns, strict=True)]
        return Elsewhere(
            rms=float(np.sqrt(np.mean(np.sum(error**2, axis=1)))),
            said_rms=float(np.sqrt(np.mean(sigma**2))),
            nees=float(np.mean(places) / 3.0),
            inside=bool(places[0] <= chi2.ppf(0.95, 3)),
            converged=fit.converged,
        )

    return at(draw.asked), at(others)


def own_optimum(draw: Draw) -> tuple[Unknown, Floats]:
    """SciPy's optimum of the posterior, started where somebody would say that everything is; no bend upwards."""
    own = _unknown(draw, draw.free)
    found = scipys_optimum(own, draw.rows)
    if own.arm(found).bend >= 0.0:
        return own, found
    own = _unknown(draw, tuple(name for name in draw.free if name != "tool_deflection"))
    return own, scipys_optimum(own, draw.rows)


def _unknown(draw: Draw, names: tuple[str, ...]) -> Unknown:
    sigma = np.array([draw.told.sigma(name, draw.flat) for name in names])
    return Unknown(names, sigma, draw.rough, draw.rough_centres)


def squared(error: Floats, covariance: Floats) -> float:
    """δᵀ C⁻¹ δ, worked out in units of σ."""
    sigma = np.sqrt(np.diag(covariance))
    scaled = error / sigma
    return float(scaled @ np.linalg.solve(covariance / np.outer(sigma, sigma), scaled))


@dataclass(frozen=True, eq=False)
class Volume:
    """The volumetric error at asked angles: 3-D, of all points (3 M,), without what nobody can see.

    With an instrument all of it is seen. Touches on spheres see neither the robot's heading nor its height: what moves
    all points as one body is taken out (`kept`, orthonormal, (3 M, 6) of it), to first order.
    """

    kept: Floats
    factor: Floats

    @classmethod
    def of(cls, draw: Draw, arm: OwnArm, columns: Floats, covariance: Floats, besides: Floats) -> Volume:
        """besides (M,): 1 σ on each axis of each point, mm, apart from what the parameters do."""
        together = rigid_motions(arm.points(draw.asked)) if len(draw.centres) else np.zeros((3 * len(columns), 0))
        root = np.linalg.cholesky(covariance + 1e-14 * np.diag(np.diag(covariance)))
        spread = columns.reshape(-1, columns.shape[-1]) @ root
        if besides.any():
            spread = np.hstack([spread, np.diag(np.repeat(besides, 3))])
        return cls(together, spread - together @ (together.T @ spread))

    def shape_of(self, error: Floats) -> Floats:
        """The errors (M, 3) without what nobody can see."""
        flat = error.ravel()
        return np.asarray((flat - self.kept @ (self.kept.T @ flat)).reshape(-1, 3))

    def rms_of(self, error: Floats) -> float:
        left = self.shape_of(error).ravel()
        return float(np.sqrt(left @ left / len(error)))

    def squared(self, error: Floats) -> Floats:
        """δᵀ C⁻¹ δ (M,) of each point alone."""
        spread = self.factor.reshape(len(error), 3, -1)
        return np.array([squared(e, s @ s.T) for e, s in zip(self.shape_of(error), spread, strict=True)])

    @property
    def said_rms(self) -> float:
        return float(np.sqrt(3.0 * np.sum(self.factor**2) / len(self.factor)))

    def quantile(self, share: float) -> float:
        """Of the mean squared error: a weighted sum of χ², by draws with a fixed seed."""
        weights = np.linalg.svd(self.factor, compute_uv=False) ** 2 * 3.0 / len(self.factor)
        drawn = np.random.default_rng(0).standard_normal((QUANTILE_DRAWS, len(weights))) ** 2 @ weights
        return float(np.quantile(drawn, share))


def rigid_motions(points: Floats) -> Floats:
    """Orthonormal basis (3 M, 6) of how points (M, 3) move as one body."""
    arms = points - points.mean(axis=0)
    moves = [np.broadcast_to(axis, arms.shape) for axis in np.eye(3)] + [
        np.cross(axis, arms) / 1e3 for axis in np.eye(3)
    ]
    basis, _ = np.linalg.qr(np.stack([move.ravel() for move in moves], axis=1))
    return np.asarray(basis)


@dataclass(frozen=True)
class Summary:
    """Figures of many draws of one set-up: shares over draws, means over draws, and counts."""

    draws: int
    nees: float
    place_nees: float
    coverage: float
    place_coverage: float
    volume_coverage: float
    rms: float
    ratio: float
    said: float
    off_scipy: float
    left_out_per_1000: float
    grown: int
    prior_scale: int
    unconverged: int

    @property
    def as_promised(self) -> bool:
        """NEES per degree of freedom 0.9 … 1.1, places and volumetric RMS in their 95 % regions in 92 … 98 % of the
        draws, no more than 2 % worse than SciPy's optimum.
        """
        nees = (self.nees, self.place_nees)
        shares = (self.place_coverage, self.volume_coverage)
        return all(0.9 <= n <= 1.1 for n in nees) and all(0.92 <= s <= 0.98 for s in shares) and self.ratio <= 1.02

    @classmethod
    def of(cls, all_of: list[Honesty]) -> Summary:
        """NEES per degree of freedom; coverages by draws; ratio: our volumetric RMS over SciPy's, same draws."""
        ours, scipys = (np.array([getattr(one, which) for one in all_of]) for which in ("rms", "scipy_rms"))
        said = np.array([one.said_rms for one in all_of])
        return cls(
            draws=len(all_of),
            nees=float(np.sum([one.nees for one in all_of]) / np.sum([one.freedom for one in all_of])),
            place_nees=float(np.mean([one.place_nees for one in all_of]) / 3.0),
            coverage=float(np.mean([one.inside for one in all_of])),
            place_coverage=float(np.mean([one.place_inside for one in all_of])),
            volume_coverage=float(np.mean([one.volume_inside for one in all_of])),
            rms=float(np.sqrt(np.mean(ours**2))),
            ratio=float(np.sqrt(np.mean(ours**2) / np.mean(scipys**2))),
            said=float(np.sqrt(np.mean(said**2))),
            off_scipy=max(one.off_scipy for one in all_of),
            left_out_per_1000=1000.0 * sum(one.left_out for one in all_of) / sum(one.rows for one in all_of),
            grown=sum(one.growth > 1.0 for one in all_of),
            prior_scale=sum(bool(one.prior_scale) for one in all_of),
            unconverged=sum(not one.converged for one in all_of),
        )
