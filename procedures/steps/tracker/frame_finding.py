"""The frames {B} and {T} from the recorded circles, the instrument's place, and the direction of gravity."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from cellctl.files import InputError
from cellctl.formats import RobotFile
from cellctl.metrology.axis_frames import (
    AxisFrames,
    NoCircle,
    ParallelAxes,
    Turn,
    axis_frames,
    reflector_on_flange,
    station,
)
from cellctl.metrology.measured_pose import MeasuredPose, gravity_in_base
from cellctl.procedure import StepContext
from procedures.steps.tracker.points import points_of
from procedures.steps.tracker.rows import FrameFigures, FramesRow, StationRow, TurnRow
from procedures.steps.tracker.station import reflector_called, robot_of, session_now
from procedures.steps.tracker.turn_planning import AXES, turn_posture

_LEVEL_SIGMA_DEG = 0.0005
"""1 σ of a compensator: 2″ are usual."""


def found_frames(context: StepContext) -> tuple[FramesRow, StationRow]:
    """The row of the frames, and the instrument's new place. Raises InputError if a circle cannot be fitted."""
    chain, joints = robot_of(context.robot_file)
    rows = context.recorded(TurnRow)
    posture = joints.model(turn_posture(context))
    try:
        a1, a2, a5, a6 = (_turn(context, rows[1:], axis) for axis in AXES)
        found = axis_frames(a1, a2, a5, a6, points_of([rows[0].point]))
    except (NoCircle, ParallelAxes) as error:
        raise InputError(context.cell.problem(("postures", "turn"), str(error), "choose another posture")) from error
    place = station(found, chain, posture)
    reflector, spread = reflector_on_flange(found, chain, posture)
    row = FramesRow(
        base=_figures(found.base),
        tool=_figures(found.tool),
        station=_figures(place),
        reflector=tuple(reflector.tolist()),
        reflector_sigma=tuple(np.sqrt(np.diag(spread)).tolist()),
        rough=tuple(reflector_called(context, rows[0].reflector).xyz),
        **_gravity(context, place, levelled=all(each.point.levelled for each in rows)),
        **_circles(found),
    )
    return row, StationRow(session=session_now(context), source="axes turned", matrix=row.station.matrix)


def _turn(context: StepContext, rows: Sequence[TurnRow], axis: int) -> Turn:
    mine = [row for row in rows if row.axis == axis]
    angles = robot_of(context.robot_file)[1].model(np.array([row.joints for row in mine]))[:, axis - 1]
    return Turn(points_of([row.point for row in mine]), angles)


def _figures(pose: MeasuredPose) -> FrameFigures:
    sigma = pose.sigma * np.array([1.0] * 3 + [np.degrees(1.0)] * 3)
    return FrameFigures(matrix=tuple(map(tuple, pose.matrix.tolist())), sigma=tuple(sigma.tolist()))


def _gravity(context: StepContext, place: MeasuredPose, *, levelled: bool) -> dict[str, Any]:
    """The angle between the instrument's vertical and the robot file's, with 1 σ, deg."""
    if not levelled:
        return {"gravity_deg": None, "gravity_sigma_deg": None}
    found = gravity_in_base(place, np.radians(_LEVEL_SIGMA_DEG))
    cosine = float(found.direction @ RobotFile.load(context.robot_file).down())
    sigma = float(np.degrees(found.sigma_tilt_rad))
    return {"gravity_deg": float(np.degrees(np.arccos(min(1.0, cosine)))), "gravity_sigma_deg": sigma}


def _circles(found: AxisFrames) -> dict[str, Any]:
    return {
        "radius": tuple(circle.radius for circle in found.circles),
        "radius_sigma": tuple(circle.sigma_radius for circle in found.circles),
        "residual": tuple(
            float(np.sqrt(np.mean((circle.height**2 + circle.radial**2)[circle.inliers]))) for circle in found.circles
        ),
        "outliers": int(sum((~circle.inliers).sum() for circle in found.circles)),
    }
