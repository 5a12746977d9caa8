"""Measuring poses that leave the least predicted error, chosen among those that the instrument sees."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cellctl.calibration import REGION_POINTS, Task
from cellctl.formats import SIGMA_COLUMNS, RobotFile, candidate_rows, design_problem, measurements
from cellctl.kinematics import Floats, abc_from_rotation, spread_over
from cellctl.planning import CHECKED_RISE, MeasuringArm, Reach, chosen_rows, measuring_postures

CANDIDATES, CANDIDATES_EACH = 1000, 8
"""Candidates of an optimal choice: at least so many in all, and for each pose of the fit."""

SIGMA_MM = 0.05
"""1 σ of the instrument on each axis: of a laser station some metres away. The choice hardly depends on it."""


def chosen_postures(
    robot: RobotFile, arm: MeasuringArm, reach: Reach, fit: int, held_out: int, seed: int, reflectors: Floats
) -> Floats:
    """Postures (fit + held_out, n), deg, those of the fit first: the best of many, and others drawn apart from these
    within the joints of the fit: outside, no table may go. reflectors (M, 3): on the flange, mm. Raises OutOfReach.
    """
    candidates = measuring_postures(arm, reach, max(CANDIDATES, CANDIDATES_EACH * fit), seed)
    chosen = candidates[best_postures(robot, candidates, fit, reflectors)]
    return np.concatenate([chosen, postures_within(chosen, arm, reach, held_out, seed + 1)])


def postures_within(chosen: Floats, arm: MeasuringArm, reach: Reach, count: int, seed: int) -> Floats:
    """Other postures (count, n), deg, drawn within the joints of those that are chosen (N, n). Raises OutOfReach."""
    if not count:
        return chosen[:0]
    margin = reach.margin + arm.options.step
    low, high = chosen.min(axis=0) - margin, chosen.max(axis=0) + margin
    inside = replace(reach, minimum=tuple(low.tolist()), maximum=tuple(high.tolist()))
    return measuring_postures(arm, inside, count, seed)


def best_postures(robot: RobotFile, candidates: Floats, count: int, reflectors: Floats) -> list[int]:
    """The `count` of candidate readings (M, n), deg, after whose measurement the robot's places are best known among
    each other, over the joints of all candidates. reflectors (M, 3), mm: one gives positions, three and more poses.
    """
    problem, q = design_problem(rows_at(robot, candidates, reflectors)), robot.joint_map().model(candidates)
    asked = problem.places(spread_over(q.min(axis=0), q.max(axis=0), REGION_POINTS, scramble=False))
    found = chosen_rows(problem.covariance, problem.candidates, asked, count, core=problem.core, most_rise=CHECKED_RISE)
    return list(found.rows)


def rows_at(robot: RobotFile, readings: Floats, reflectors: Floats) -> Task:
    """The fit of rows at readings (M, n), deg, as the nominal robot would show them. reflectors (K, 3): on the flange,
    mm.
    """
    tool = robot.tool.model_copy(update={"xyz": tuple(reflectors[0].tolist())})
    seen = robot.model_copy(update={"tool": tool})
    poses = seen.chain().forward(robot.joint_map().model(readings))
    sigma = float(np.hypot(SIGMA_MM, robot.repeatability / np.sqrt(3.0)))
    columns = dict(zip("XYZ", poses[:, :3, 3].T.tolist(), strict=True)) | dict.fromkeys(
        SIGMA_COLUMNS, [sigma] * len(poses)
    )
    if len(reflectors) >= 3:
        columns |= dict(zip("ABC", abc_from_rotation(poses[:, :3, :3]).T.tolist(), strict=True))
    return measurements(seen, candidate_rows(readings, columns)).task
