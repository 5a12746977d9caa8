"""Planes that were touched, as a fit found them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np

from cellctl.calibration.estimation.estimate import Estimate
from cellctl.calibration.estimation.task import Task
from cellctl.calibration.rows.planes import by_pole, planes_of
from cellctl.kinematics import Floats


@final
@dataclass(frozen=True, eq=False)
class PlaneEstimate:
    """The plane that is point number `point` of its task: normal (3,) · x = offset_mm, tools on the normal's side.

    sigma_mm: 1 σ of its place along the normal, in the middle of its touches; tilt_sigma_deg: 1 σ of the normal, over
    both tilts.
    """

    point: int
    normal: Floats
    offset_mm: float
    sigma_mm: float
    tilt_sigma_deg: float


def plane_estimates(task: Task, found: Estimate) -> list[PlaneEstimate]:
    """The planes of `task` where the rows `found` them, in the measuring frame."""
    return [_estimate(task, found, point) for point in sorted(task.planes)]


def _estimate(task: Task, found: Estimate, point: int) -> PlaneEstimate:
    state, pole = found.state, found.state.points[point]
    touching = [block for block in task.rows.blocks if block.of_planes]
    tcps = [state.models[block.session].tcp(block.postures)[block.visited == point] for block in touching]
    middle = np.concatenate(tcps).mean(axis=0)
    own = state.points_at + 3 * point + np.arange(3)
    covariance = found.covariance[np.ix_(own, own)]
    normal, offset = planes_of(pole)
    along, level = by_pole(pole[None], middle[None])[0], np.eye(3) - np.outer(normal, normal)
    tilts = max(float(np.trace(level @ covariance @ level)), 0.0) / float(pole @ pole)
    return PlaneEstimate(
        point=point,
        normal=normal,
        offset_mm=float(offset),
        sigma_mm=float(np.sqrt(max(along @ covariance @ along, 0.0))),
        tilt_sigma_deg=float(np.rad2deg(np.sqrt(tilts))),
    )
