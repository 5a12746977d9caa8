"""Identification from one kind of rows: find the rows that belong together, register, fit, judge the noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, TypeAlias, final

import numpy as np

from cellctl.calibration.estimate import Estimate, estimate
from cellctl.calibration.model import RobotModel
from cellctl.calibration.outliers import Linear, belonging
from cellctl.calibration.registration import register_poses, register_positions, sphere_centre
from cellctl.calibration.rows import PoseRows, PositionRows, Rows, SpacingRows, TouchRows
from cellctl.calibration.unknowns import Group, State, Tolerances, Unknowns
from cellctl.kinematics import Bools, Floats

Measured: TypeAlias = PositionRows | PoseRows | TouchRows

OUTLIERS_AT_MOST = 0.2
"""If more of the rows than this do not belong to the others, nothing says which of them are right, and all stay."""

CLOSEST = 0.6
"""The share of the rows, those nearest to nominal, that the search for the rows that belong together starts from."""

ROUNDS = 8

OVERDETERMINED = 2
"""Measured numbers for each unknown of the registration from which on rows can say something of each other."""


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
        return self.registering // len(self.rows.quantities) + 1

    @property
    def registering(self) -> int:
        """How many numbers registration has to find: 3 for each sphere; 9 or 12 for base and tool."""
        return 3 * len(self.spheres) or (12 if isinstance(self.rows, PoseRows) else 9)


@final
@dataclass(frozen=True, eq=False)
class Identification:
    """The nominal robot registered on the rows, the identified one, and how noisy the rows turned out to be.

    noise (k,): by how much the rows' standard deviations had to grow, for each of a row's numbers. used, outliers:
    indices into the task's rows that made the fit, both estimates alike, and that were left out of it. apart: how many
    rows did not belong to the others where that was too many to leave them out; 0 otherwise.
    """

    nominal: Estimate
    identified: Estimate
    noise: Floats
    used: tuple[int, ...]
    outliers: tuple[int, ...]
    apart: int = 0


def identify(task: Task, fit: Any = None) -> Identification:
    """Identify `task.model` from the rows at `fit` (indices or mask; default all). No other row is looked at.

    Rows that do not belong to the others are left out. Noise: if the residuals of the rest are clearly larger than the
    rows' σ say (χ² beyond its own 4 σ), σ grows to match, for positions and rotations apart, and the fit is repeated,
    as otherwise the tolerances would weigh too little and every predicted σ be too small. It never shrinks.
    """
    chosen = np.arange(len(task.rows)) if fit is None else np.arange(len(task.rows))[fit]
    rows = task.rows.pick(chosen)
    kept = _belonging(task, rows)
    apart = int(np.count_nonzero(~kept))
    if apart > OUTLIERS_AT_MOST * len(rows):
        kept = np.ones(len(rows), bool)
    nominal = _registered(task, rows.pick(kept))
    found, noise = _fit_with_noise(_start_of(task, nominal), rows.pick(kept), _certain(task))
    return Identification(
        nominal=nominal,
        identified=found,
        noise=noise,
        used=tuple(chosen[kept].tolist()),
        outliers=tuple(chosen[~kept].tolist()),
        apart=apart if kept.all() else 0,
    )


def _registered(task: Task, rows: Measured) -> Estimate:
    """The nominal robot, tied to the measurement by `rows`."""
    return estimate(_unknowns(task, _start(task, rows)).only(task.registration), [rows])


def _start_of(task: Task, nominal: Estimate) -> Unknowns:
    """What is to be identified, expected where nominal is registered."""
    unknowns = _unknowns(task, nominal.unknowns.start)
    return unknowns.restarted(nominal.state).only(task.registration | task.groups)


def _certain(task: Task) -> list[Rows]:
    return [task.spacings] if task.spacings is not None else []


def _belonging(task: Task, rows: Measured) -> Bools:
    """Which rows (N,) belong together, found about the fit of those that do, and again until they stay the same.

    All, where these are too few to say anything of each other.
    """
    if len(rows) * len(rows.quantities) < OVERDETERMINED * task.registering:
        return np.ones(len(rows), bool)
    start = _start_of(task, _registered_on_closest(task, rows))
    deviations, before, noise = np.zeros(len(start.names)), None, np.ones(rows.sigma.shape[1])
    for _ in range(ROUNDS):
        balanced = rows.noisier(noise / noise.min())
        kept = belonging(Linear.about(start, deviations, balanced, _certain(task))).kept
        if before is not None and np.array_equal(kept, before):
            break
        found, noise = _fit_with_noise(start, rows.pick(kept), _certain(task))
        deviations, before = found.deviations, kept
    return kept


def _registered_on_closest(task: Task, rows: Measured) -> Estimate:
    """Nominal registered on the share of rows that is nearest to it: wild rows do not decide where it starts."""
    nominal, share = _registered(task, rows), max(int(CLOSEST * len(rows)), task.rows_at_least)
    for _ in range(ROUNDS):
        closest = np.argsort(rows.errors(nominal.state), kind="stable")[:share]
        nominal = _registered(task, rows.pick(np.sort(closest)))
    return nominal


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
