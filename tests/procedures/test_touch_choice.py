"""The touches of a fit, chosen by the error that they leave: the held-out ones stay apart, and the plan is better."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from cellctl.calibration.prediction.predict import sigma_over_region
from cellctl.files import load_yaml
from cellctl.formats import DataSet, RobotFile, artefact_of, measurements
from cellctl.formats.design_problem import design_problem
from procedures.steps.sphere.planning import checked, planned_touches
from procedures.steps.sphere.touch_plans import TouchPlan
from tests.helpers.arms import Floats
from tests.helpers.runs import CELL, ROOT
from tests.helpers.steps import Context

ROBOT_FILE = ROOT / "procedures" / "robots" / "kr5_r1400.yaml"
SPHERES = ["S1", "S2", "S3"]


def plans(folder: Path, choice: str) -> list[TouchPlan]:
    context = Context(run_folder=folder, robot_file=ROBOT_FILE, cell=load_yaml(CELL))
    context.seed = 1  # type: ignore[attr-defined]
    return planned_touches(context, 24, 9, SPHERES, 10, choice)  # type: ignore[arg-type]


def predicted_mm(touches: list[TouchPlan]) -> float:
    """1 σ among places of the robot after a fit of geometry and tool to these touches, by their information."""
    robot, artefact = RobotFile.load(ROBOT_FILE), artefact_of(load_yaml(CELL), ("artefact",))
    cells = tuple((*touch.end, touch.sphere) for touch in touches)
    data = DataSet("plan", (*(f"A{axis}" for axis in range(1, 7)), "sphere"), cells, tuple(range(len(cells))))
    problem = design_problem(measurements(robot, data, artefact=artefact, model="geometry").task)
    rows = np.concatenate(problem.candidates)
    scale = np.sqrt(np.diag(problem.covariance)) + 1e-12
    known = np.linalg.inv(problem.covariance / np.outer(scale, scale) + 1e-12 * np.eye(len(scale)))
    after: Floats = np.linalg.inv(known + (rows * scale).T @ (rows * scale)) * np.outer(scale, scale)
    model = problem.state.models[0]
    q = robot.joint_map().model(np.array([touch.end for touch in touches]))
    count = len(model.parameters)
    return sigma_over_region(model, after[:count, :count], q.min(axis=0), q.max(axis=0))


@pytest.mark.long
def test_blocks_of_the_best_touches_are_drawn_at_random_with_held_out_ones_among_them(tmp_path: Path) -> None:
    """So that a drift is not the error of a place: each sphere, and held-out touches, in both halves."""
    touches = [touch for touch in plans(tmp_path, "optimal") if touch.set != "reference"]
    halves = touches[: len(touches) // 2], touches[len(touches) // 2 :]
    for half in halves:
        assert set(Counter(touch.sphere for touch in half)) == set(SPHERES)
        assert {touch.set for touch in half} == {"fit", "test"}
    plan = plans(tmp_path, "optimal")
    references = [at for at, touch in enumerate(plan) if touch.set == "reference"]
    assert references == [10, 21, 32], "after each ten"


@pytest.mark.long
def test_what_is_said_of_few_touches_is_that_none_is_checked() -> None:
    context = Context(robot_file=ROBOT_FILE, cell=load_yaml(CELL))
    context.seed = 1  # type: ignore[attr-defined]
    few, enough = (
        checked(context, planned_touches(context, count, 0, SPHERES, 0, "optimal"), True)  # type: ignore[arg-type]
        for count in (25, 35)
    )
    assert few.startswith("No touch can be checked by the others: 25 identify the robot, and 35 are needed")
    assert enough.startswith("Each touch is checked by the others: without any one the predicted error rises by")
    assert float(enough.partition("rises by ")[2].partition(" %")[0]) <= 30.0


@pytest.mark.long
def test_the_best_touches_leave_less_error_and_the_held_out_ones_are_spread_as_ever(tmp_path: Path) -> None:
    best, even = (plans(tmp_path, choice) for choice in ("optimal", "even"))
    assert Counter(touch.set for touch in best) == {"fit": 24, "test": 9, "reference": 3}
    judges = Counter(touch.sphere for touch in best if touch.set == "test")
    assert judges == Counter(touch.sphere for touch in even if touch.set == "test")
    of_fit = [[touch for touch in each if touch.set == "fit"] for each in (best, even)]
    assert set(Counter(touch.sphere for touch in of_fit[0])) == set(SPHERES)
    assert predicted_mm(of_fit[0]) < 0.9 * predicted_mm(of_fit[1])
    assert [touch.end for touch in plans(tmp_path, "optimal")] == [touch.end for touch in best]
