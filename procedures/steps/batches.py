"""Campaigns in batches: what the rows of the fit tell of the robot's volumetric error, whether it is enough, and which
rows would tell most more. Held-out rows only say where the error counts.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from itertools import pairwise
from statistics import mean, median
from typing import Self, TypeVar, final

import numpy as np

from cellctl.calibration import REGION_POINTS, FitResult, shape_columns, sigma_doubts
from cellctl.calibration import Task as FitTask
from cellctl.formats import design_problem
from cellctl.kinematics import Floats, JointMap, spread_over
from cellctl.planning import BatchProgress, PredictedError, StopLimits, chosen_rows, ended_by, root_after
from cellctl.procedure import StepContext
from cellctl.records import BatchRow
from procedures.steps.batch_inputs import BatchInputs

Planned = TypeVar("Planned")
Inputs = TypeVar("Inputs", bound=BatchInputs)

RANGED_FROM = 10
"""So many held-out rows have ranges of their own."""

_PAUSE = 10.0
"""A gap between two rows longer than this many times the median was a pause, or the run was resumed after it."""


@final
@dataclass(frozen=True)
class Task:
    """Where the robot's error counts: model angles lower … upper (n,), rad.

    The ranges of the held-out rows, which are spread evenly and judge the model; of all, where these are too few.
    The best rows of a fit are at the ends of the joints: a box about them is mostly where nobody measured or works.
    """

    lower: tuple[float, ...]
    upper: tuple[float, ...]

    @classmethod
    def of(cls, rows: Iterable[tuple[str, tuple[float, ...]]], joints: JointMap) -> Self:
        """From set and readings, deg, of all rows so far."""
        every = list(rows)
        judges = [readings for of, readings in every if of == "test"]
        return cls.about(np.array(judges if len(judges) >= RANGED_FROM else [each for _, each in every]), joints)

    @classmethod
    def about(cls, readings: Floats, joints: JointMap) -> Self:
        """The ranges of readings (N, n), deg, in whole degrees: what a held-out row measured does not come in."""
        q = joints.model(np.array([np.floor(readings.min(axis=0)), np.ceil(readings.max(axis=0))]))
        return cls(tuple(q.min(axis=0).tolist()), tuple(q.max(axis=0).tolist()))

    @property
    def places(self) -> Floats:
        """Model angles (REGION_POINTS, n), rad, spread evenly."""
        return spread_over(np.array(self.lower), np.array(self.upper), REGION_POINTS, scramble=False)


@final
@dataclass(frozen=True, eq=False)
class Forecast:
    """The error that a fit predicts over a task, and why that cannot be trusted (or ""). rows: of the campaign, by
    which its limits count; each: rows of the fit that one of them makes.
    """

    rows: int
    model: str
    error: PredictedError
    doubt: str
    each: float = 1.0

    @classmethod
    def of(cls, rows: int, fitted: FitTask, result: FitResult, task: Task, few: str = "", each: float = 1.0) -> Self:
        """few: why so few rows cannot be trusted, or ""."""
        identified = result.identification.identified
        state, region, places = identified.state, result.region, task.places
        asked = state.spread(shape_columns(state.model, places)[:, None, :], 0)[:, 0, :]
        beside = 3.0 * state.model.open_variance(places) + region.outside(places) ** 2
        doubt = "; ".join([*([few] if few else []), *sigma_doubts(fitted, result.identification)])
        error = PredictedError.of(identified.covariance, asked, float(beside.mean()), region.scatter_mm**2)
        return cls(rows, result.model, error, doubt, each)


def rows_in_sigma(task: FitTask, result: FitResult) -> Floats:
    """Jacobians (N, k, P) of all rows of a task about the identified robot, in the standard deviations that its fit
    found.
    """
    state = result.identification.identified.state
    blocks = [block for block in task.rows.noisier(result.identification.noise).blocks if len(block)]
    return np.concatenate([block.jacobian(state) / block.sigma[..., None] for block in blocks])


def best_next(task: FitTask, made: int, asked_at: Task, count: int, noise: float = 1.0) -> list[int]:
    """The `count` of the candidates, rows of a task after the first `made`, that leave the least error over `asked_at`
    besides these. noise: factor on the stated σ of a row.
    """
    problem = design_problem(task)
    rows = problem.candidates / noise
    root = root_after(problem.covariance, rows[:made])
    asked = problem.places(asked_at.places)
    return list(chosen_rows(np.eye(root.shape[1]), rows[made:] @ root, asked @ root, count).rows)


async def next_rows(
    context: StepContext,
    work: Callable[[StepContext, Inputs], tuple[BatchRow, list[Planned]]],
    inputs: Inputs,
) -> tuple[list[Planned], str]:
    """What `work` plans after a batch, whose row is recorded; nothing after the end. And what ended the campaign."""
    done = context.recorded(BatchRow)
    if done and done[-1].ended:
        return [], done[-1].ended
    row, following = await context.clock.compute(work, context, inputs)
    await context.record(row)
    context.say(row.sentence)
    return following, row.ended


def after_batch(
    noun: str,
    inputs: BatchInputs,
    known: Forecast,
    times_ns: Iterable[int],
    plan: Callable[[int], tuple[list[Planned], Floats, Floats]],
) -> tuple[BatchRow, list[Planned]]:
    """What is known after a batch, and the next one; empty where the campaign ends.

    times_ns: of all measurements so far. plan: of the next so many rows, with Jacobians (N, k, P), (M, k, P) of those
    that were made and of these, in their standard deviations.
    """
    limits = StopLimits(inputs.goal_mm, inputs.most, 60.0 * inputs.minutes, inputs.gain_percent / 100.0)
    seconds, of_each = _seconds(times_ns)
    now, size = known.error.now, min(inputs.size, inputs.most - known.rows)
    following = known.each * size + inputs.held_out_at_last
    at = BatchProgress(known.rows, now.high_mm, 0.0, seconds + of_each * following, known.doubt)
    planned: list[Planned] = []
    ended, next_mm, to_goal = ended_by(limits, at), None, None
    if not ended:
        planned, made, coming = plan(size)
        next_mm = known.error.after(coming).high_mm
        most = int(np.ceil(known.each * (limits.rows - at.rows)))
        more = known.error.rows_to(limits.goal_mm, np.concatenate([made, coming]), most)
        to_goal = None if more is None else int(np.ceil(more / known.each))
        ended = ended_by(limits, replace(at, next_mm=next_mm))
    row = BatchRow(
        noun=noun,
        rows=at.rows,
        most=limits.rows,
        goal_mm=limits.goal_mm,
        low_mm=now.low_mm,
        median_mm=now.median_mm,
        high_mm=now.high_mm,
        next_mm=next_mm,
        to_goal=to_goal,
        seconds=round(seconds, 3),
        model=known.model,
        doubt=known.doubt,
        ended=ended or "",
    )
    return row, [] if ended else planned


def _seconds(times_ns: Iterable[int]) -> tuple[float, float]:
    """What the measurements at these times took, without pauses; and one of them, with what comes between."""
    gaps = [1e-9 * (after - before) for before, after in pairwise(sorted(times_ns))]
    usual = median(gap for gap in gaps if gap > 0.0)
    worked = [gap for gap in gaps if 0.0 < gap < _PAUSE * usual]
    return sum(worked), mean(worked)
