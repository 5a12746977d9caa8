"""Identification: find the rows that belong together, register, fit, judge the noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, final

import numpy as np

from cellctl.calibration.effects import DEFLECTION
from cellctl.calibration.estimate import Estimate, covariance_of, estimate
from cellctl.calibration.mixture import Mixture
from cellctl.calibration.outliers import OUTLYING, Linear, belonging
from cellctl.calibration.predict import foresee
from cellctl.calibration.rows import Rows
from cellctl.calibration.task import Task
from cellctl.calibration.unknowns import Unknowns
from cellctl.kinematics import Bools, Floats

OUTLIERS_AT_MOST = 0.2
"""If more of the rows than this do not belong to the others, nothing says which of them are right, and all stay."""

CLOSEST = 0.6
"""The share of the rows, those nearest to nominal, that the search for the rows that belong together starts from."""

ROUNDS = 8

OVERDETERMINED = 2
"""Measured numbers for each unknown of the registration from which on rows can say something of each other."""

SEARCHED = 3000
"""Rows among which those that belong together are searched for; more are judged by what a sample of these foresees."""


@final
@dataclass(frozen=True, eq=False)
class Identification:
    """The nominal robot registered on the rows, the identified one, and how noisy the rows turned out to be.

    noise: by how much the rows' standard deviations had to grow, for each of `Mixture.quantities`. used, outliers:
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
    chosen = np.arange(len(task.rows)) if fit is None else np.sort(np.arange(len(task.rows))[fit])
    kept, apart = rows_together(task, task.rows.pick(chosen))
    nominal, found, noise = identify_kept(task, task.rows.pick(chosen[kept]))
    return Identification(
        nominal=nominal,
        identified=found,
        noise=noise,
        used=tuple(chosen[kept].tolist()),
        outliers=tuple(chosen[~kept].tolist()),
        apart=apart,
    )


def identify_kept(task: Task, rows: Mixture) -> tuple[Estimate, Estimate, Floats]:
    """Nominal registered on `rows`, identified, and the noise; every row is taken to belong to the others."""
    nominal = _registered(task, rows)
    return nominal, *_fit_with_noise(_start_of(task, nominal), rows, _certain(task))


def rows_together(task: Task, rows: Mixture) -> tuple[Bools, int]:
    """Which of `rows` (N,) belong together; and how many do not, where that is too many to leave them out: all are then
    kept.
    """
    if len(rows) > SEARCHED:
        sample = np.sort(np.random.default_rng(len(rows)).permutation(len(rows))[:SEARCHED])
        kept = _like_sample(task, rows, sample)
    else:
        kept = _belonging(task, rows)
    apart = int(np.count_nonzero(~kept))
    return (np.ones(len(rows), bool), apart) if apart > OUTLIERS_AT_MOST * len(rows) else (kept, 0)


def _like_sample(task: Task, rows: Mixture, sample: Any) -> Bools:
    """Which of `rows` (N,) lie where those of `sample` (indices) that belong together foresee them."""
    of_sample = rows.pick(sample)
    together = _belonging(task, of_sample)
    _, found, noise = identify_kept(task, of_sample.pick(together))
    blocks = rows.noisier(noise).blocks
    chances = [foresee(found.state, found.covariance, block).chance for block in blocks]
    kept = np.asarray(np.concatenate(chances) >= OUTLYING)
    kept[sample] = together
    return kept


def _registered(task: Task, rows: Mixture) -> Estimate:
    """The nominal robot, tied to the measurement by `rows`."""
    unknowns = task.unknowns(task.start(rows))
    return estimate(unknowns.masked(task.registration(unknowns)), rows.blocks)


def _start_of(task: Task, nominal: Estimate) -> Unknowns:
    """What is to be identified, expected where nominal is registered."""
    unknowns = task.unknowns(nominal.state)
    return unknowns.masked(task.identification(unknowns))


def _certain(task: Task) -> list[Rows]:
    return [task.spacings] if task.spacings is not None else []


def _belonging(task: Task, rows: Mixture) -> Bools:
    """Which rows (N,) belong together, found about the fit of those that do, and again until they stay the same.

    All, where these are too few to say anything of each other.
    """
    if rows.size < OVERDETERMINED * task.registering:
        return np.ones(len(rows), bool)
    start = _start_of(task, _registered_on_closest(task, rows))
    deviations, before, noise = np.zeros(len(start.names)), None, np.ones(len(rows.quantities))
    for _ in range(ROUNDS):
        balanced = rows.noisier(noise / noise.min())
        kept = belonging(Linear.about(start, deviations, balanced, _certain(task))).kept
        if before is not None and np.array_equal(kept, before):
            break
        found, noise = _fit_with_noise(start, rows.pick(kept), _certain(task), deviations)
        deviations, before = found.deviations, kept
    return kept


def _registered_on_closest(task: Task, rows: Mixture) -> Estimate:
    """Nominal registered on the share of rows that is nearest to it: wild rows do not decide where it starts."""
    nominal, share = _registered(task, rows), max(int(CLOSEST * len(rows)), task.rows_at_least)
    before: Any = None
    for _ in range(ROUNDS):
        closest = np.sort(np.argsort(rows.errors(nominal.state), kind="stable")[:share])
        if np.array_equal(closest, before):
            break
        nominal, before = estimate(nominal.unknowns, rows.pick(closest).blocks, nominal.deviations), closest
    return nominal


def _fit_with_noise(
    unknowns: Unknowns, rows: Mixture, spacings: Sequence[Rows], begin: Floats | None = None
) -> tuple[Estimate, Floats]:
    """The fit, repeated while its residuals ask for more noise; at most four times. A bend cannot be negative."""
    noise = np.ones(len(rows.quantities))
    found = _fit(unknowns, [*rows.blocks, *spacings], begin)
    for _ in range(4):
        growth = _growth(rows.noisier(noise), found)
        if np.all(growth == 1.0):
            break
        noise = noise * growth
        found = _fit(unknowns, [*rows.noisier(noise).blocks, *spacings], found.deviations)
    return found, noise


def _fit(unknowns: Unknowns, blocks: Sequence[Rows], begin: Floats | None = None) -> Estimate:
    """The fit; a bend held at 0, as it cannot be negative, leaves everything as uncertain as before it was held."""
    found = estimate(unknowns, blocks, begin)
    bend = found.state.model.amount(DEFLECTION)
    if bend is None or bend >= 0.0:
        return found
    held = estimate(unknowns.without(frozenset({DEFLECTION})), blocks)
    return replace(held, covariance=covariance_of(held, unknowns, blocks))


def _growth(rows: Mixture, found: Estimate) -> Floats:
    """Factors by which σ has to grow: 1 where χ² is within four of its own standard deviations."""
    state, factors = found.state, np.ones(len(rows.quantities))
    share = max(1.0 - found.seen_by_data / max(rows.size, 1), 1.0 / max(rows.size, 1))
    for block, _, own in rows.parts():
        if not len(block):
            continue
        squares = np.sum((block.residual(state) / block.sigma) ** 2, axis=0)
        for quantity in dict.fromkeys(block.quantities):
            columns = np.array(block.quantities) == quantity
            count = columns.sum() * len(block) * share
            ratio = float(squares[columns].sum()) / count
            if ratio > 1.0 + 4.0 * np.sqrt(2.0 / count):
                factors[own][columns] = np.sqrt(ratio)
    return factors
