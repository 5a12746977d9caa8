"""Circles of single turned axes: planned with the reflector visible, and the frames {B} and {T} and gravity by them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from cellctl.files import InputError
from cellctl.formats import RobotFile, floor_of, postures_of, reflectors_of
from cellctl.kinematics import Bools, Floats
from cellctl.metrology import (
    AxisFrames,
    MeasuredPose,
    NoCircle,
    ParallelAxes,
    Turn,
    axis_frames,
    gravity_in_base,
    reflector_on_flange,
    station,
)
from cellctl.procedure import CellContext, StepContext
from procedures.steps.tracker.pose_plans import PosePlan
from procedures.steps.tracker.reflectors import points_of
from procedures.steps.tracker.rows import FrameFigures, FramesRow, StationRow, TurnRow
from procedures.steps.tracker.station import reflector_called, robot_of, rough_station, session_now

AXES = (1, 2, 5, 6)
"""Axes that are turned, from 1: they give {B} and {T}."""

APPROACH_DEG = 3.0
"""Each point is approached from this far below it: from one side, so that backlash does not matter."""

_LEAST_ARC_DEG, _WIDEST_DEG, _STEP_DEG = 30.0, 120.0, 1.0
_MARGIN_DEG = 4.0
"""Margin of the reflector's acceptance: the instrument's place is rough, and the robot is not nominal."""


def turn_posture(context: CellContext) -> Floats:
    """The posture from which axes are turned (n,), deg; also the return pose. Raises InputError."""
    robot = RobotFile.load(context.robot_file)
    turn = postures_of(context.cell, robot, "turn").turn
    return np.array(turn, float)


def return_pose(context: CellContext, origin: Sequence[float], number: int) -> PosePlan:
    """A visit to the return pose, all axes from below."""
    return approached(number, "return", context, origin, turn_posture(context))


def approached(number: int, kind: str, context: CellContext, origin: Sequence[float], joints: Floats) -> PosePlan:
    """A pose with all axes approached from below."""
    return PosePlan.model_validate(
        {
            "number": number,
            "kind": kind,
            "reflector": reflectors_of(context.cell).on_flange[0].id,
            "origin": rounded(origin),
            "way": [rounded(joints - APPROACH_DEG)],
            "joints": rounded(joints),
            "direction": [1] * len(joints),
        }
    )


def planned_turns(context: CellContext, points: int) -> list[PosePlan]:
    """The posture itself, then `points` of each circle in the sense of growing readings.

    Raises InputError if the reflector is visible on too small an arc.
    """
    posture, name = turn_posture(context), reflectors_of(context.cell).on_flange[0].id
    plans = [approached(0, "turn", context, posture.tolist(), posture).model_copy(update={"axis": AXES[0]})]
    here = posture
    for axis in AXES:
        low, high = _arc(context, posture, axis, name)
        for reading in np.linspace(low, high, points):
            joints, before = posture.copy(), posture.copy()
            joints[axis - 1], before[axis - 1] = reading, reading - APPROACH_DEG
            direction = [int(number == axis) for number in range(1, len(posture) + 1)]
            plans.append(
                PosePlan(
                    number=len(plans),
                    kind="turn",
                    reflector=name,
                    origin=rounded(here),
                    way=[rounded(before)],
                    joints=rounded(joints),
                    direction=direction,
                    axis=axis,
                )
            )
            here = joints
    return plans


def rounded(joints: Iterable[float]) -> list[float]:
    """Joints as plans hold them, deg."""
    return [round(float(angle), 4) for angle in joints]


def _arc(context: CellContext, posture: Floats, axis: int, name: str) -> tuple[float, float]:
    """Least and greatest reading of `axis`, deg, between which every point can be measured."""
    joint = RobotFile.load(context.robot_file).joints[axis - 1]
    middle = posture[axis - 1]
    low, high = max(joint.min + 2 * APPROACH_DEG, middle - _WIDEST_DEG / 2), min(joint.max, middle + _WIDEST_DEG / 2)
    readings = np.arange(low, high, _STEP_DEG)
    rows = np.repeat(posture[None], len(readings), axis=0)
    rows[:, axis - 1] = readings
    good = _measurable(context, rows, name)
    below, above = readings[~good & (readings < middle)], readings[~good & (readings > middle)]
    first = max(low, below.max() + _STEP_DEG) if below.size else low
    last = min(high, above.min() - _STEP_DEG) if above.size else high
    if last - first < _LEAST_ARC_DEG:
        what = f"the reflector is visible on {max(last - first, 0.0):.0f}° only when A{axis} turns from this posture"
        cure = f"choose a posture with {_LEAST_ARC_DEG:.0f}° at least, the reflector facing the instrument"
        raise InputError(context.cell.problem(("postures", "turn"), what, cure))
    return float(first), float(last)


def _measurable(context: CellContext, rows: Floats, name: str) -> Bools:
    """Whether the reflector faces the instrument and the tool is above the floor, for readings (N, n), deg."""
    robot, reflector, floor = (
        RobotFile.load(context.robot_file),
        reflector_called(context, name),
        floor_of(context.cell),
    )
    chain, q = robot.chain(), robot.joint_map().model(rows)
    flange = chain.forward_flange(q)
    place = flange[:, :3, 3] + flange[:, :3, :3] @ np.array(reflector.xyz)
    facing = flange[:, :3, :3] @ (np.array(reflector.facing) / np.linalg.norm(reflector.facing))
    beam = rough_station(context)[:3, 3] - place
    cosine = np.einsum("nk,nk->n", facing, beam) / np.linalg.norm(beam, axis=1)
    good = cosine > np.cos(np.radians(reflectors_of(context.cell).acceptance_deg - _MARGIN_DEG))
    if floor is None:
        return np.asarray(good)
    lowest = np.min([chain.frames(q)[:, 2:, 2, 3].min(axis=1), chain.forward(q)[:, 2, 3], place[:, 2]], axis=0)
    return np.asarray(good & (lowest > floor.z + floor.clearance_mm))


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
