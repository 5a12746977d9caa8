"""Finds where the instrument is: from the nests' rough places, or from circles of single turned axes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from cellctl.calibration import rigid_fit
from cellctl.formats import station_of
from cellctl.procedure import CellContext, NoInputs, StepContext, StepResult, step
from procedures.steps.tracker.circles import found_frames, planned_turns, return_pose
from procedures.steps.tracker.plan_inputs import TurnInputs
from procedures.steps.tracker.pose_plans import PosePlan
from procedures.steps.tracker.rows import FramesRow, NestRow, StationRow
from procedures.steps.tracker.station import session_now


class Located(StepResult):
    """The largest distance of a measured nest from the cell file's place, mm, with the instrument at its new place."""

    residual_mm: float


@step("tracker.locate")
async def locate(context: StepContext, inputs: NoInputs) -> Located:
    """Carry the measured nests to their places in the cell file; so reflectors are aimed at more closely."""
    row, residual = await context.clock.compute(_located, context)
    await context.record(row)
    x, y, z = (line[3] for line in row.matrix[:3])
    context.say(f"instrument at {x:.0f}, {y:.0f}, {z:.0f} mm; nests up to {residual:.1f} mm from their rough places")
    return Located(residual_mm=residual)


def _located(context: StepContext) -> tuple[StationRow, float]:
    given = {nest.id: np.array(nest.xyz, float) for nest in station_of(context.cell).nests}
    measured = {row.nest: np.array(row.point.xyz) for row in context.recorded(NestRow)}
    there, here = (np.array([places[name] for name in given]) for places in (given, measured))
    matrix = rigid_fit(here, there)
    residual = float(np.linalg.norm(here @ matrix[:3, :3].T + matrix[:3, 3] - there, axis=1).max())
    row = StationRow(session=session_now(context), source="nests", matrix=tuple(map(tuple, matrix.tolist())))
    return row, residual


class Turns(StepResult):
    """The points of all circles, in order; the first one is the posture from which the axes are turned.

    back: the return pose after them.
    """

    poses: list[PosePlan]
    back: PosePlan


def _check_turns(context: CellContext, known: Mapping[str, Any]) -> None:
    planned_turns(context, known.get("points", 9))


@step("tracker.plan_turns", check=_check_turns)
async def plan_turns(context: StepContext, inputs: TurnInputs) -> Turns:
    """Plan the circles of A1, A2, A5 and A6 about one posture, the reflector visible on each point."""
    poses = await context.clock.compute(planned_turns, context, inputs.points)
    return Turns(poses=poses, back=return_pose(context, poses[-1].joints, len(poses)))


class Registered(StepResult):
    """The reflector's place in the flange frame, mm, by the circles."""

    reflector: list[float]


@step("tracker.frames")
async def frames(context: StepContext, inputs: NoInputs) -> Registered:
    """Fit the circles, find the frames {B} and {T} with their σ, and where the instrument is."""
    row, station = await context.clock.compute(found_frames, context)
    for each in (row, station):
        await context.record(each)
    context.say(_sentence(row))
    return Registered(reflector=list(row.reflector))


def _sentence(row: FramesRow) -> str:
    x, y, z = row.station.matrix[0][3], row.station.matrix[1][3], row.station.matrix[2][3]
    sigma = max(row.station.sigma[:3])
    off = sum((a - b) ** 2 for a, b in zip(row.reflector, row.rough, strict=True)) ** 0.5
    return (
        f"instrument at {x:.1f}, {y:.1f}, {z:.1f} mm in the robot's base frame (1 σ {sigma:.2f}); reflector "
        f"{off:.2f} mm from the cell file's place on the flange"
    )
