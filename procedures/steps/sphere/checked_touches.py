"""Whether touches check each other: by how much the predicted error rises without one, and leverage.

An outlier shows itself by its residual. A touch that the fit takes from itself (leverage 1) has none: what is wrong
there passes for an error of the robot. The model is the geometry, tool and centres that every fit of touches has.
"""

from __future__ import annotations

from collections.abc import Sequence

from cellctl.calibration import REGION_POINTS
from cellctl.formats import Artefact, RobotFile, candidate_rows, design_problem, measurements
from cellctl.kinematics import Floats, spread_over
from cellctl.planning import CHECKED_RISE, chosen_rows

CHECKED_FROM = 35
"""With fewer touches none can be checked by the others: a fit of the geometry takes nearly each of them from itself."""


def checked_words(
    robot: RobotFile, artefact: Artefact, spheres: Sequence[str], readings: Floats, use_distances: bool
) -> str:
    """What is said of touches on `spheres` (N,) at readings (N, n), deg, from which a robot is identified."""
    count, q = len(readings), robot.joint_map().model(readings)
    data = candidate_rows(readings, {"sphere": list(spheres)})
    task = measurements(robot, data, model="geometry", artefact=artefact, use_distances=use_distances).task
    problem = design_problem(task)
    asked = problem.places(spread_over(q.min(axis=0), q.max(axis=0), REGION_POINTS, scramble=False))
    found = chosen_rows(problem.covariance, problem.candidates, asked, count)
    most, leverage = 100.0 * float(found.rises.max()), float(found.leverage.mean())
    if count < CHECKED_FROM:
        return (
            f"No touch can be checked by the others: {count} identify the robot, and {CHECKED_FROM} are needed; their "
            f"mean leverage is {leverage:.2f}, and 1 is that of a touch which no other one checks."
        )
    unchecked = int((found.rises > CHECKED_RISE).sum())
    if unchecked:
        return (
            f"{unchecked} of {count} touches are not checked by the others: without one of them the predicted error "
            f"rises by {most:.0f} % (mean leverage {leverage:.2f})."
        )
    return (
        f"Each touch is checked by the others: without any one the predicted error rises by {most:.0f} % at most (mean "
        f"leverage {leverage:.2f})."
    )
