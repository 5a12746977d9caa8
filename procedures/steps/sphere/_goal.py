"""The goal of a campaign, and whether it is met: held-out touches have to agree with what ended it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np

from cellctl.calibration import FitResult
from cellctl.calibration.distributions import chi2_ppf
from cellctl.procedure import StepContext
from cellctl.records import ENDED, BatchRow
from procedures.steps.sphere.rows import SphereVerdict

_UNLIKELY = 0.05
"""Held-out errors contradict a goal if a robot that meets it has errors as large as these less often."""


@final
@dataclass(frozen=True)
class GoalFigures:
    """goal_mm: asked for; predicted_mm, median_mm: 95 % quantile and median of the volumetric error, after `rows`
    touches. ended: what ended the campaign. met: also by the held-out touches; why: in words.
    """

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
        known = f"below {self.predicted_mm:.3f} mm with 95 % after {self.rows} touches"
        return f"Goal of {self.goal_mm:g} mm {'met' if self.met else 'not met'} (predicted {known}): {self.why}."


def goal_figures(context: StepContext, result: FitResult, sigma_mm: float) -> GoalFigures | None:
    """What became of the goal; None for a run without batches. sigma_mm: 1 σ of one touch along the normal."""
    last = next(reversed(context.recorded(BatchRow)), None)
    if last is None:
        return None
    noise = sigma_mm * float(result.identification.noise[0])
    against = _contradiction(result, last.goal_mm, noise) if last.ended == "goal" else ENDED.get(last.ended, "")
    why = against or f"{result.n_test} held-out touches do not contradict it"
    return GoalFigures(last.goal_mm, last.high_mm, last.median_mm, last.rows, last.ended, not against, why)


def _contradiction(result: FitResult, goal_mm: float, noise_mm: float) -> str:
    """Why held-out touches deny a volumetric error of `goal_mm`; empty if they do not.

    One axis has a third of its square. Of n independent errors with variance s², the sum of squares is above
    s² χ²_n(0.95) once in twenty: s is at least the root of the sum over χ²_n(0.95).
    """
    if result.sigma_ok is not True:
        return f"the predicted error cannot be trusted ({result.sigma_reason})"
    errors = result.test_errors
    at_least = np.sqrt(np.sum(errors**2) / chi2_ppf(1.0 - _UNLIKELY, len(errors)))
    allowed = np.hypot(goal_mm / np.sqrt(3.0), noise_mm)
    if at_least > allowed:
        return f"held-out touches are off by {at_least:.3f} mm at least, and it allows {allowed:.3f} mm along a normal"
    return ""


def goal_of(verdict: SphereVerdict) -> GoalFigures | None:
    """What the verdict on held-out touches has of the goal; None without one."""
    found = (verdict.model or {}).get("goal")
    return GoalFigures(**found) if found else None


def with_goal(verdict: str, goal: GoalFigures | None) -> str:
    """`not met` where the robot is better than nominal, and its goal is not met; else `verdict`."""
    return "not met" if verdict == "better" and goal and not goal.met else verdict


def unmet(goal: GoalFigures | None) -> str:
    """What a verdict's sentence says besides of a goal that is not met."""
    return f" The goal of {goal.goal_mm:g} mm is not met." if goal and not goal.met else ""
