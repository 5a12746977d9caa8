"""Our side: `identify`, from registration and the search for wild rows to the noise and every parameter's σ."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from serving import Rows, Tip, serve

from cellctl.calibration import PositionRows, RobotModel, Task, identify
from cellctl.kinematics import Link, SerialChain, pose_from_xyz_abc


def task_of(rows: Rows) -> Task:
    """Geometry and tool of the MDH chain, with its base: 24 + 3 + 6 unknowns."""
    links = [Link(theta=theta, d=d, a=a, alpha=alpha) for alpha, a, theta, d in rows["links"]]
    base, tool = (pose_from_xyz_abc(rows[frame][:3], np.rad2deg(rows[frame][3:])) for frame in ("base", "tool"))
    model = RobotModel(SerialChain.from_links("dh-craig", links, base, tool))
    measured = PositionRows(rows["q"], rows["xyz"], np.full(rows["xyz"].shape, float(rows["sigma"])))
    return Task(model, measured, groups=frozenset({"geometry", "tool"}))


def prepare(rows: Rows) -> Callable[[], Tip]:
    task = task_of(rows)
    return lambda: identify(task).identified.state.model.tcp


if __name__ == "__main__":
    serve(prepare)
