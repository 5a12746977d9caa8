"""The touches of a fit that leave the least predicted error, chosen among those that can be made."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from cellctl.calibration import REGION_POINTS
from cellctl.formats import Artefact, RobotFile, candidate_rows, design_problem, measurements
from cellctl.kinematics import Floats, spread_over
from cellctl.planning import CHECKED_RISE, chosen_rows
from procedures.steps.sphere.checked_touches import CHECKED_FROM


@final
@dataclass(frozen=True)
class TouchChoice:
    """Chooses `count` touches by the mean variance of the robot's places among each other, under all terms that `auto`
    tries, a discrepancy, and the centres of the spheres (without these, all touches would be on one sphere).

    artefact: the cell's, with its certified distances if `use_distances`. names: of the spheres, in the plan's order.
    """

    robot: RobotFile
    artefact: Artefact
    names: tuple[str, ...]
    count: int
    use_distances: bool

    def __call__(self, spheres: NDArray[np.int_], readings: Floats) -> NDArray[np.int_]:
        """Indices (count,) among candidates: the sphere (M,) and readings at the contact (M, n), deg, of each."""
        data = candidate_rows(readings, {"sphere": [self.names[index] for index in spheres]})
        found = measurements(self.robot, data, artefact=self.artefact, use_distances=self.use_distances)
        problem, joints = design_problem(found.task), self.robot.joint_map()
        q = joints.model(readings)
        asked = problem.places(spread_over(q.min(axis=0), q.max(axis=0), REGION_POINTS, scramble=False))
        most_rise = CHECKED_RISE if self.count >= CHECKED_FROM else None
        best = chosen_rows(
            problem.covariance, problem.candidates, asked, self.count, core=problem.core, most_rise=most_rise
        )
        return np.array(best.rows)
