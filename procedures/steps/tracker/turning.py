"""Turns single axes, and finds from the circles where instrument and reflector are."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import Field

from cellctl.procedure import CellContext, NoInputs, StepContext, StepInputs, StepResult, step
from procedures.steps.tracker.plans import PosePlan
from procedures.steps.tracker.rows import FramesRow


class TurnInputs(StepInputs):
    """Points of each circle."""

    points: Annotated[int, Field(ge=5, le=200)] = 9


class Turns(StepResult):
    """The points of all circles, in order; the first one is the posture from which the axes are turned.

    back: the return pose after them.
    """

    poses: list[PosePlan]
    back: PosePlan


def _check_turns(context: CellContext, known: Mapping[str, Any]) -> None:
    from procedures.steps.tracker.turn_planning import planned_turns

    planned_turns(context, known.get("points", 9))


@step(
    "tracker.plan_turns",
    check=_check_turns,
    title="planning the circles",
    expects=lambda known: 1 + 4 * int(known.get("points", 0)),
)
async def plan_turns(context: StepContext, inputs: TurnInputs) -> Turns:
    """Plan the circles of A1, A2, A5 and A6 about one posture, the reflector visible on each point."""
    from procedures.steps.tracker.turn_planning import planned_turns, return_pose

    poses = await context.clock.compute(planned_turns, context, inputs.points)
    return Turns(poses=poses, back=return_pose(context, poses[-1].joints, len(poses)))


class Registered(StepResult):
    """The reflector's place in the flange frame, mm, by the circles."""

    reflector: list[float]


@step("tracker.frames", title="finding the frames")
async def frames(context: StepContext, inputs: NoInputs) -> Registered:
    """Fit the circles, find the frames {B} and {T} with their σ, and where the instrument is."""
    from procedures.steps.tracker.frame_finding import found_frames

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
