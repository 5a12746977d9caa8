"""Plans the circles: how far each axis turns from one posture with the reflector visible, clear of the floor."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from cellctl.files import InputError
from cellctl.formats import RobotFile, postures_of
from cellctl.formats.cell_sections import floor_of, reflectors_of
from cellctl.kinematics import Bools, Floats
from cellctl.procedure import CellContext
from procedures.steps.tracker.plans import PosePlan
from procedures.steps.tracker.station import reflector_called, rough_station

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
