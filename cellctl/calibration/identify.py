"""Identification from one kind of rows: register, fit, judge the noise, leave out what cannot be, fit again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, TypeAlias, final

import numpy as np
from scipy.stats import chi2

from cellctl.calibration.estimate import Estimate, estimate
from cellctl.calibration.model import RobotModel
from cellctl.calibration.registration import register_poses, register_positions, sphere_centre
from cellctl.calibration.rows import PoseRows, PositionRows, Rows, SpacingRows, TouchRows
from cellctl.calibration.unknowns import Group, State, Tolerances, Unknowns
from cellctl.kinematics import Bools, Floats

Measured: TypeAlias = PositionRows | PoseRows | TouchRows

OUTLYING = 1e-7
"""A fit row is left out, and named, where scatter of the size of the others would put it less often than this."""

OUTLIERS_AT_MOST = 0.1
"""If more of the rows than this lie outside, it is the model that is wrong, and all stay."""


@final
@dataclass(frozen=True, eq=False)
class Task:
    """What is identified, from what.

    model: nominal robot. rows: everything measured. spheres, centres: names, and rough centres (S, 3), mm (NaN where
    not known). spacings: certified distances, or None. groups: what may change besides what registers the robot to
    the measurement (centres for touches; base and tool for an instrument's points and poses).
    """

    model: RobotModel
    rows: Measured
    spheres: tuple[str, ...] = ()
    centres: Floats | None = None
    spacings: SpacingRows | None = None
    groups: frozenset[Group] = frozenset({"geometry", "tool", "deflection"})
    tolerances: Tolerances = field(default_factory=Tolerances)

    @property
    def registration(self) -> frozenset[Group]:
        """What ties the robot to the measurement and is always free, with nothing known beforehand."""
        return frozenset({"centres"}) if isinstance(self.rows, TouchRows) else frozenset({"base", "tool"})

    @property
    def rows_at_least(self) -> int:
        """With fewer rows than this, registration alone explains everything: 9 or 12 numbers, or 3 for each sphere."""
        unknowns = 3 * len(self.spheres) or (12 if isinstance(self.rows, PoseRows) else 9)
        return unknowns // len(self.rows.quantities) + 1


@final
@dataclass(frozen=True, eq=False)
class Identification:
    """The nominal robot registered on the rows, the identified one, and how noisy the rows turned out to be.

    noise (k,): by how much the rows' standard deviations had to grow, for each of a row's numbers. used, outliers:
    indices into the task's rows that made the fit, and that were left out of it.
    """

    nominal: Estimate
    identified: Estimate
    noise: Floats
    used: tuple[int, ...]
    outliers: tuple[int, ...]


def identify(task: Task, fit: Any = None) -> Identification:
    """Identify `task.model` from the rows at `fit` (indices or mask; default all). No other row is looked at.

    Noise: if the residuals are clearly larger than the rows' σ say (χ² beyond its own 4 σ), σ grows to match, for
    positions and rotations apart, and the fit is repeated, as otherwise the tolerances would weigh too little and every
    predicted σ be too small. It never shrinks.
    """
    chosen = np.arange(len(task.rows)) if fit is None else np.arange(len(task.rows))[fit]
    rows = task.rows.pick(chosen)
    unknowns = _unknowns(task, _start(task, rows))
    nominal = estimate(unknowns.only(task.registration), [rows])
    spacings = [task.spacings] if task.spacings is not None else []
    start = unknowns.restarted(nominal.state).only(task.registration | task.groups)
    kept = np.ones(len(rows), bool)
    found, noise = _fit_with_noise(start, rows, spacings)
    for _ in range(3):
        outside = _outlying(rows, found, kept)
        if not outside.any() or (~kept | outside).mean() > OUTLIERS_AT_MOST:
            break
        kept &= ~outside
        found, noise = _fit_with_noise(start, rows.pick(kept), spacings)
    return Identification(nominal, found, noise, tuple(chosen[kept].tolist()), tuple(chosen[~kept].tolist()))


def _unknowns(task: Task, start: State) -> Unknowns:
    registered: frozenset[Group] = task.registration
    unknowns = Unknowns.of(start, task.spheres, task.tolerances, registered=registered)
    if isinstance(task.rows, PoseRows):
        return unknowns
    return unknowns.without(frozenset({"tool_a", "tool_b", "tool_c"}))  # a point has no orientation


def _start(task: Task, rows: Measured) -> State:
    model = task.model
    if isinstance(rows, TouchRows):
        return State(model, _start_centres(task, rows))
    if isinstance(rows, PoseRows):
        chain = register_poses(model.chain, rows.q, rows.poses)
    else:
        chain = register_positions(model.chain, rows.q, rows.xyz)
    return State(replace(model, chain=chain), np.zeros((0, 3)))


def _start_centres(task: Task, rows: TouchRows) -> Floats:
    centres = np.full((len(task.spheres), 3), np.nan) if task.centres is None else task.centres.copy()
    tips = task.model.tip(rows.q)
    for index in np.flatnonzero(np.isnan(centres).any(axis=1)):
        mine = rows.sphere == index
        if mine.any():
            centres[index] = sphere_centre(tips[mine], rows.reach[mine])
    return np.where(np.isnan(centres), tips.mean(axis=0), centres)


def _fit_with_noise(unknowns: Unknowns, rows: Measured, spacings: Sequence[Rows]) -> tuple[Estimate, Floats]:
    """The fit, repeated while its residuals ask for more noise; at most four times. A bend cannot be negative."""
    noise = np.ones(rows.sigma.shape[1])
    found = _fit(unknowns, [rows, *spacings])
    for _ in range(4):
        growth = _growth(rows.noisier(noise), found)
        if np.all(growth == 1.0):
            break
        noise = noise * growth
        found = _fit(unknowns, [rows.noisier(noise), *spacings])
    return found, noise


def _fit(unknowns: Unknowns, blocks: Sequence[Rows]) -> Estimate:
    found = estimate(unknowns, blocks)
    deflection = found.state.model.deflection
    if deflection is not None and deflection.c_t < 0.0:
        return estimate(unknowns.only(frozenset(set(unknowns.groups) - {"deflection"})), blocks)
    return found


def _growth(rows: Measured, found: Estimate) -> Floats:
    """Factors (k,) by which σ has to grow: 1 where χ² is within four of its own standard deviations."""
    weighted = (rows.residual(found.state) / rows.sigma) ** 2
    share = max(1.0 - found.seen_by_data / weighted.size, 1.0 / weighted.size)
    factors = np.ones(weighted.shape[1])
    quantities = np.array(rows.quantities)
    for quantity in dict.fromkeys(rows.quantities):
        columns = quantities == quantity
        count = columns.sum() * len(rows) * share
        ratio = float(weighted[:, columns].sum()) / count
        if ratio > 1.0 + 4.0 * np.sqrt(2.0 / count):
            factors[columns] = np.sqrt(ratio)
    return factors


def _outlying(rows: Measured, found: Estimate, kept: Bools) -> Bools:
    """Which kept rows lie far outside, measured by the median of all: a few wild rows do not widen their own limit."""
    squares = np.sum((rows.residual(found.state) / rows.sigma) ** 2, axis=-1)
    k = rows.sigma.shape[1]
    limit = float(np.median(squares[kept])) * chi2.isf(OUTLYING, k) / chi2.median(k)
    return np.asarray(kept & (squares > limit))
