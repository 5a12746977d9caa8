"""The goal of a campaign, and whether it is met: held-out rows have to agree with what ended it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np

from cellctl.calibration import FitResult, chi2_ppf
from cellctl.procedure import StepContext
from cellctl.records import ENDED, BatchRow, VerdictRow

_UNLIKELY = 0.05
"""Held-out errors contradict a goal if a robot that meets it has errors as large as these less often."""

_OPEN = "the batches are used up"


@final
@dataclass(frozen=True)
class GoalFigures:
    """goal_mm: asked for; predicted_mm, median_mm: 95 % quantile and median of the volumetric error, after `rows` of
    what `noun` names. ended: what ended the campaign. met: also by the held-out ones; why: in words.
    """

    noun: str
    goal_mm: float
    predicted_mm: float
    median_mm: float
    rows: int
    ended: str
    met: bool
    why: str

    @property
    def sentence(self) -> str:
        """For the operator."""
        known = f"below {self.predicted_mm:.3f} mm with 95 % after {self.rows} {self.noun}"
        return f"Goal of {self.goal_mm:g} mm {'met' if self.met else 'not met'} (predicted {known}): {self.why}."


def goal_figures(context: StepContext, result: FitResult, sigma_mm: float, axes: int = 1) -> GoalFigures | None:
    """What became of the goal; None for a run without batches. sigma_mm: 1 σ of what a row measures along each of its
    `axes`: 1, the normal of a touch, or 3, of a place.
    """
    last = next(reversed(context.recorded(BatchRow)), None)
    if last is None:
        return None
    noise = sigma_mm * float(result.identification.noise[0])
    against = _contradiction(result, last, noise, axes) if last.ended == "goal" else ENDED.get(last.ended, _OPEN)
    why = against or f"{result.n_test} held-out {last.noun} do not contradict it"
    return GoalFigures(last.noun, last.goal_mm, last.high_mm, last.median_mm, last.rows, last.ended, not against, why)


def _contradiction(result: FitResult, last: BatchRow, noise_mm: float, axes: int) -> str:
    """Why held-out rows deny a volumetric error of the goal; empty if they do not.

    One axis has a third of its square. Of n independent errors with variance s², the sum of squares is above
    s² χ²_n(0.95) once in twenty: s is at least the root of the sum over χ²_n(0.95). The axes of a place are not
    independent: their mean square counts as one error.
    """
    if result.sigma_ok is False:  # None: these rows cannot show whether it can be trusted
        return f"the predicted error cannot be trusted ({result.sigma_reason})"
    squares = result.test_errors**2 / axes
    at_least = np.sqrt(np.sum(squares) / chi2_ppf(1.0 - _UNLIKELY, len(squares)))
    allowed = np.hypot(last.goal_mm / np.sqrt(3.0), noise_mm)
    if at_least > allowed:
        along = "along a normal" if axes == 1 else "along each axis"
        return f"held-out {last.noun} are off by {at_least:.3f} mm at least, and it allows {allowed:.3f} mm {along}"
    return ""


def goal_of(verdict: VerdictRow) -> GoalFigures | None:
    """What the verdict on held-out rows has of the goal; None without one."""
    found = (verdict.model or {}).get("goal")
    return GoalFigures(**found) if found else None


def with_goal(verdict: str, goal: GoalFigures | None) -> str:
    """`not met` where the robot is better than nominal, and its goal is not met; else `verdict`."""
    return "not met" if verdict == "better" and goal and not goal.met else verdict


def unmet(goal: GoalFigures | None) -> str:
    """What a verdict's sentence says besides of a goal that is not met."""
    return f" The goal of {goal.goal_mm:g} mm is not met." if goal and not goal.met else ""
