"""Plans poses of the identification, and held-out ones or targets by a method, in rounds between nest visits."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import Field

from cellctl.procedure import CellContext, StepContext, StepInputs, StepResult, step
from procedures.steps.tracker.model_files import read_model
from procedures.steps.tracker.pose_planning import planned_rounds, planned_targets
from procedures.steps.tracker.pose_plans import DEFAULT_METHOD, Round, check_method
from procedures.steps.tracker.station import base_from_instrument


class PlanInputs(StepInputs):
    """fit: poses to identify from; held_out: all that judge; monuments_every: poses between two visits to the nests.

    from_both: share of the fit's poses that are measured from both sides. reflectors: of the plate, all visible.
    pose_file: file of the poses, from the cell file's folder; empty: they are planned here.
    """

    fit: Annotated[int, Field(ge=10, le=2000)]
    held_out: Annotated[int, Field(ge=0, le=1000)]
    monuments_every: Annotated[int, Field(ge=5)] = 30
    from_both: Annotated[float, Field(ge=0, le=1)] = 0.15
    reflectors: Annotated[int, Field(ge=1, le=8)] = 1
    pose_file: str = ""


class Plan(StepResult):
    """All poses, in rounds."""

    rounds: list[Round]


def _check_plan(context: CellContext, known: Mapping[str, Any]) -> None:
    if {"fit", "held_out", "monuments_every", "from_both", "reflectors", "pose_file"} <= known.keys():
        planned_rounds(context, PlanInputs.model_validate(dict(known)), None)


def _passes(known: Mapping[str, Any]) -> int:
    poses = round(known.get("fit", 0) * (1.0 + known.get("from_both", 0.0)) + known.get("held_out", 0))
    return int(poses - (-poses // max(1, known.get("monuments_every", 1))))


@step("tracker.plan", check=_check_plan, reads_files=True, title="planning poses", expects=_passes)
async def plan(context: StepContext, inputs: PlanInputs) -> Plan:
    """Plan quasi-random poses, or take them from a file: visible, clear of floor and arm, in random order, each
    approached from a stated side."""
    station = base_from_instrument(context)
    rounds = await context.clock.compute(planned_rounds, context, inputs, station)
    visits = sum(len(each.poses) for each in rounds)
    twice = visits - inputs.fit - inputs.held_out
    context.say(
        f"planned {inputs.fit} poses to identify from ({twice} of them from both sides) and {inputs.held_out} held out"
    )
    return Plan(rounds=rounds)


class PlanTargetsInputs(StepInputs):
    """fit: poses to identify from if no model was read; registration: poses that register one that was read.

    targets: how many at most; target_file: file of the targets, from the cell file's folder; empty: they are planned.
    from_both: share of the identification's poses that are measured from both sides. method, passes, online: of
    compensation, as in `tracker.compensate`.
    """

    fit: Annotated[int, Field(ge=10, le=2000)]
    registration: Annotated[int, Field(ge=8, le=500)]
    targets: Annotated[int, Field(ge=3, le=500)]
    target_file: str = ""
    monuments_every: Annotated[int, Field(ge=5)] = 30
    from_both: Annotated[float, Field(ge=0, le=1)] = 0.15
    method: str = DEFAULT_METHOD
    passes: Annotated[int, Field(ge=0)] = 0
    online: bool = False


def _check_targets(context: CellContext, known: Mapping[str, Any]) -> None:
    """Whether a model is read is not known yet: as many poses as are needed in any case."""
    check_method(context, known)
    if {"fit", "registration", "targets", "target_file"} <= known.keys():
        wanted = PlanTargetsInputs.model_validate(dict(known))
        least = min(wanted.fit, wanted.registration)
        planned_targets(context, wanted.model_copy(update={"fit": least}), None)


@step(
    "tracker.plan_targets",
    check=_check_targets,
    reads_files=True,
    title="planning the targets",
    expects=lambda known: 2 * int(known.get("targets", 0)) + int(known.get("fit", 0)),
)
async def plan_targets(context: StepContext, inputs: PlanTargetsInputs) -> Plan:
    """Plan the targets, or take them from a file, with the poses that identify or register the model; name those that
    cannot be measured or compensated."""
    found = await context.clock.compute(planned_targets, context, inputs, read_model(context))
    await context.record(found.row)
    context.say(f"planned {found.row.targets} targets; {len(found.row.left_out)} left out")
    for each in found.row.left_out:
        context.say(f"left out: {each}")
    return Plan(rounds=found.rounds)
