"""pybotics' side: its `OptimizationHandler` and `optimize_accuracy` under SciPy's `least_squares`, as in its example.

Two things help it beyond that example, in which SciPy scales no unknown and stops where steps are small: with mm and
rad in one vector that is far from the minimum. The unknowns are scaled by the Jacobian, the quickest of SciPy's ways
here; and it ends as soon as the residual is what the request asks for, which nobody could know beforehand.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from pybotics.geometry import vector_2_matrix
from pybotics.optimization import OptimizationHandler, optimize_accuracy
from pybotics.robot import Robot
from scipy.optimize import least_squares
from serving import Rows, Tip, serve

NEVER = 1e-15
"""For SciPy's own tolerances."""


def prepare(rows: Rows) -> Callable[[float], Tip]:
    """Fits all 24 link parameters, the tool's x, y, z and the base, from nominal, until the residual is `reach`, mm."""

    def fit(reach: float) -> Tip:
        robot = Robot.from_parameters(rows["links"].copy())
        robot.world_frame, robot.tool.matrix = vector_2_matrix(rows["base"]), vector_2_matrix(rows["tool"])
        handler = OptimizationHandler(robot, [True] * 24, [True] * 3 + [False] * 3, [True] * 6)

        def near_enough(intermediate_result: Any) -> None:
            if 2.0 * intermediate_result.cost <= reach**2 * len(rows["q"]):
                raise StopIteration

        found = least_squares(
            optimize_accuracy,
            handler.generate_optimization_vector(),
            args=(handler, rows["q"], rows["xyz"]),
            x_scale="jac",
            ftol=NEVER,
            xtol=NEVER,
            gtol=NEVER,
            callback=near_enough,
        )
        handler.apply_optimization_vector(found.x)
        return lambda q: np.array([handler.robot.fk(angles)[:3, 3] for angles in q])

    return fit


if __name__ == "__main__":
    serve(prepare)
