"""Choosing 50 of 5000 positions under the whole model, beside the plain formula for one exchange of each row."""

from __future__ import annotations

from time import process_time

import numpy as np
import pytest

from cellctl.formats import RobotFile, measurements
from cellctl.formats.design_problem import candidate_rows, design_problem
from cellctl.formats.measurements.columns import SIGMA_COLUMNS
from cellctl.kinematics.low_discrepancy import spread_over
from cellctl.planning.design import chosen_rows
from tests.helpers.arms import KR5_FILE

COUNT, CANDIDATES, TIMES = 50, 5000, 10


@pytest.mark.long
def test_a_design_of_the_whole_model_takes_a_tenth_of_the_plain_formula(tell):
    robot, rng = RobotFile.load(KR5_FILE), np.random.default_rng(1)
    low, high = np.array([-60, -110, 50, -90, 20, -120.0]), np.array([60, -50, 120, 90, 80, 120.0])
    readings = rng.uniform(low, high, (CANDIDATES, 6))
    q = robot.joint_map().model(readings)
    places = dict(zip("XYZ", robot.chain().forward(q)[:, :3, 3].T, strict=True)) | dict.fromkeys(
        SIGMA_COLUMNS, [0.03] * len(q)
    )
    problem = design_problem(measurements(robot, candidate_rows(readings, places)).task)
    asked = problem.places(spread_over(q.min(axis=0), q.max(axis=0), 256, scramble=False))

    began = process_time()
    found = chosen_rows(problem.covariance, problem.candidates, asked, COUNT)
    ours = process_time() - began

    rows, weight = problem.candidates.reshape(-1, len(problem.covariance)), asked.T @ asked
    began = process_time()
    carried = rows @ problem.covariance
    np.einsum("ip,ip->i", carried @ weight, carried)
    plain = COUNT * (process_time() - began)
    assert len(set(found.rows)) == COUNT
    what = f"choose {COUNT} of {CANDIDATES} positions, {np.count_nonzero(problem.covariance.diagonal())} parameters"
    tell(
        what,
        f"{ours:.1f} s",
        f"the plain formula, once for each row: {plain:.0f} s",
        f"{plain / ours:.0f} ×",
        f"≥ {TIMES} ×",
    )
    assert plain / ours >= TIMES
