"""What touches tell of the robot's volumetric error, and the touches that would tell most more."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self, final

import numpy as np
from numpy.typing import NDArray

from cellctl.calibration import Drift
from cellctl.calibration.prediction.predict import POINTS, shape_columns
from cellctl.calibration.verdict.proof import sigma_doubts
from cellctl.formats import Measurements, measurements
from cellctl.formats.design_problem import candidate_rows, design_problem
from cellctl.kinematics import Floats, JointMap
from cellctl.kinematics.low_discrepancy import spread_over
from cellctl.planning import PlannedTouch, TouchOptions
from cellctl.planning.design import chosen_rows
from cellctl.planning.stopping import PredictedError, root_after
from procedures.steps.sphere._identification import FittedTouches, TouchModel, fitted_touches
from procedures.steps.sphere.rows import TouchRow

CHECKED_FROM = 35
"""With fewer touches of the fit no goal is met. Without some one of them the predicted error is more than 30 % larger,
so that the others do not check it; and `auto` may lack terms: from 20 touches it predicted 0.7 mm where 1.2 were found.
"""


RANGED_FROM = 10
"""So many held-out touches have ranges of their own."""


@final
@dataclass(frozen=True)
class Task:
    """Where the robot's error counts: model angles lower … upper (n,), rad.

    The ranges of the held-out touches, which are spread evenly and judge the model; of all, where these are too few.
    The best touches of a fit are at the ends of the joints: a box about them is mostly where nobody measured or works.
    """

    lower: tuple[float, ...]
    upper: tuple[float, ...]

    @classmethod
    def of(cls, touches: Sequence[TouchRow], joints: JointMap) -> Self:
        """From all touches so far."""
        judges = [row.joints for row in touches if row.set == "test"]
        return cls.about(np.array(judges if len(judges) >= RANGED_FROM else [row.joints for row in touches]), joints)

    @classmethod
    def about(cls, readings: Floats, joints: JointMap) -> Self:
        """The ranges of readings (N, n), deg, in whole degrees: what a held-out touch measured does not come in."""
        q = joints.model(np.array([np.floor(readings.min(axis=0)), np.ceil(readings.max(axis=0))]))
        return cls(tuple(q.min(axis=0).tolist()), tuple(q.max(axis=0).tolist()))

    @property
    def places(self) -> Floats:
        """Model angles (POINTS, n), rad, spread evenly."""
        return spread_over(np.array(self.lower), np.array(self.upper), POINTS, scramble=False)


@final
@dataclass(frozen=True, eq=False)
class Known:
    """A fit of touches, the error that it predicts over a task, and why that cannot be trusted (or "")."""

    choice: TouchModel
    task: Task
    touches: tuple[TouchRow, ...]
    found: FittedTouches
    error: PredictedError
    doubt: str

    @classmethod
    def of(cls, every: Sequence[TouchRow], choice: TouchModel, drift: Drift) -> Self:
        """From all touches so far; held-out ones only say where the robot's error counts."""
        touches = [row for row in every if row.set == "fit"]
        found, _ = fitted_touches(touches, choice, drift)
        identified = found.result.identification.identified
        state, region = identified.state, found.result.region
        task = Task.of(every, choice.robot.joint_map())
        places = task.places
        asked = state.spread(shape_columns(state.model, places)[:, None, :], 0)[:, 0, :]
        beside = 3.0 * state.model.open_variance(places) + region.outside(places) ** 2
        doubts = sigma_doubts(found.measured.task, found.result.identification)
        few = f"fewer than {CHECKED_FROM} touches do not check each other"
        doubt = "; ".join([*([few] if len(touches) < CHECKED_FROM else []), *doubts])
        error = PredictedError.of(identified.covariance, asked, float(beside.mean()), region.scatter_mm**2)
        return cls(choice, task, tuple(touches), found, error, doubt)

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
        block = _with_candidates(self.choice, self.touches, readings, spheres).task.rows.blocks[0]
        state = self.found.result.identification.identified.state
        rows = block.jacobian(state) / (self.noise * block.sigma[..., None])
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
        problem = design_problem(_with_candidates(self.choice, self.touches, readings, named).task)
        rows, made = problem.candidates / self.noise, len(self.touches)
        root = root_after(problem.covariance, rows[:made])
        asked = problem.places(self.task.places)
        return np.array(chosen_rows(np.eye(root.shape[1]), rows[made:] @ root, asked @ root, self.count).rows)
