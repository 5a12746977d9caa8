"""What touches tell of the robot's volumetric error, and the touches that would tell most more."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self, final

import numpy as np
from numpy.typing import NDArray

from cellctl.calibration import Drift
from cellctl.formats import Measurements, candidate_rows, measurements
from cellctl.kinematics import Floats
from cellctl.planning import PlannedTouch, TouchOptions
from procedures.steps.batches import Forecast, Task, best_next, rows_in_sigma
from procedures.steps.sphere._identification import FittedTouches, TouchModel, fitted_touches
from procedures.steps.sphere.rows import TouchRow

CHECKED_FROM = 35
"""With fewer touches of the fit no goal is met. Without some one of them the predicted error is more than 30 % larger,
so that the others do not check it; and `auto` may lack terms: from 20 touches it predicted 0.7 mm where 1.2 were found.
"""


@final
@dataclass(frozen=True, eq=False)
class Known:
    """A fit of touches, and the error that it predicts over a task."""

    choice: TouchModel
    task: Task
    touches: tuple[TouchRow, ...]
    found: FittedTouches
    forecast: Forecast

    @classmethod
    def of(cls, every: Sequence[TouchRow], choice: TouchModel, drift: Drift) -> Self:
        """From all touches so far; held-out ones only say where the robot's error counts."""
        touches = [row for row in every if row.set == "fit"]
        found, _ = fitted_touches(touches, choice, drift)
        task = Task.of(((row.set, row.joints) for row in every), choice.robot.joint_map())
        few = f"fewer than {CHECKED_FROM} touches do not check each other" if len(touches) < CHECKED_FROM else ""
        forecast = Forecast.of(len(touches), found.measured.task, found.result, task, few)
        return cls(choice, task, tuple(touches), found, forecast)

    @property
    def noise(self) -> float:
        """Factor on the stated σ of a touch."""
        return float(self.found.result.identification.noise[0])

    def rows_with(self, touches: Sequence[PlannedTouch]) -> tuple[Floats, Floats]:
        """Jacobians (N, 1, P), (M, 1, P) of the touches that were made and of those that are planned, in their standard
        deviations, by the identified robot.
        """
        readings = np.array([contact(touch) for touch in touches])
        spheres = [touch.sphere for touch in touches]
        rows = rows_in_sigma(_with_candidates(self.choice, self.touches, readings, spheres).task, self.found.result)
        return rows[: len(self.touches)], rows[len(self.touches) :]


def contact(touch: PlannedTouch) -> Floats:
    """Readings (n,), deg, of the contact that is expected: between start and end of the search."""
    options = TouchOptions()
    share = options.guard / (options.guard + options.depth)
    return np.asarray(np.array(touch.start) + share * (np.array(touch.end) - np.array(touch.start)))


def _with_candidates(
    choice: TouchModel, touches: Sequence[TouchRow], readings: Floats, spheres: Sequence[str]
) -> Measurements:
    """The touches that were made, then candidates at readings (M, n), deg: their spheres have the same numbers."""
    made = np.array([row.joints for row in touches])
    names = [*(row.sphere for row in touches), *spheres]
    data = candidate_rows(np.concatenate([made, readings]), {"sphere": names})
    return measurements(
        choice.robot, data, model=choice.model, artefact=choice.artefact, use_distances=choice.use_distances
    )


@final
@dataclass(frozen=True)
class NextTouches:
    """Chooses `count` touches as `TouchChoice` does, by what is left after those that were made.

    names: of the spheres, in the plan's order. noise: factor on the stated σ of a touch.
    """

    choice: TouchModel
    task: Task
    touches: tuple[TouchRow, ...]
    noise: float
    names: tuple[str, ...]
    count: int

    def __call__(self, spheres: NDArray[np.int_], readings: Floats) -> NDArray[np.int_]:
        """Indices (count,) among candidates: the sphere (M,) and readings at the contact (M, n), deg, of each."""
        named = [self.names[index] for index in spheres]
        task = _with_candidates(self.choice, self.touches, readings, named).task
        return np.array(best_next(task, len(self.touches), self.task, self.count, self.noise))
