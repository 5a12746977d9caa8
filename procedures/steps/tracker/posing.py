"""Plans poses of the identification, and held-out ones or targets by a method, in rounds between nest visits."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from cellctl.procedure import CellContext, StepContext, StepResult, step
from procedures.steps.tracker.model_files import read_model
from procedures.steps.tracker.plan_inputs import PlanInputs, PlanTargetsInputs
from procedures.steps.tracker.pose_planning import planned_rounds, planned_targets
from procedures.steps.tracker.pose_plans import Round, check_method
from procedures.steps.tracker.station import base_from_instrument


class Plan(StepResult):
    """All poses, in rounds."""

    rounds: list[Round]


class BatchedPlan(Plan):
    """With a goal the poses before the first batch, and the numbers of the batches at most."""

    batches: list[int]


def _check_plan(context: CellContext, known: Mapping[str, Any]) -> None:
    if {"fit", "held_out", "monuments_every", "from_both", "reflectors", "pose_file", "choice"} <= known.keys():
        planned_rounds(context, PlanInputs.model_validate(dict(known)), None)


@step("tracker.plan", check=_check_plan, reads_files=True)
async def plan(context: StepContext, inputs: PlanInputs) -> BatchedPlan:
    """Plan quasi-random poses, the best of many, or those of a file: visible, clear of floor and arm, in random order,
    each approached from a stated side."""
    station = base_from_instrument(context)
    rounds = await context.clock.compute(planned_rounds, context, inputs, station)
    visits = sum(len(each.poses) for each in rounds)
    count, held_out = inputs.at_first, inputs.held_out_at_first
    twice = visits - count - held_out
    context.say(f"planned {count} poses to identify from ({twice} of them from both sides) and {held_out} held out")
    return BatchedPlan(rounds=rounds, batches=list(range(inputs.batches)))


def _check_targets(context: CellContext, known: Mapping[str, Any]) -> None:
    """Whether a model is read is not known yet: as many poses as are needed in any case."""
    check_method(context, known)
    if {"fit", "registration", "targets", "target_file"} <= known.keys():
        wanted = PlanTargetsInputs.model_validate(dict(known))
        least = min(wanted.fit, wanted.registration)
        planned_targets(context, wanted.model_copy(update={"fit": least}), None)


@step("tracker.plan_targets", check=_check_targets, reads_files=True)
async def plan_targets(context: StepContext, inputs: PlanTargetsInputs) -> Plan:
    """Plan the targets, or take them from a file, with the poses that identify or register the model; name those that
    cannot be measured or compensated."""
    found = await context.clock.compute(planned_targets, context, inputs, read_model(context))
    await context.record(found.row)
    context.say(f"planned {found.row.targets} targets; {len(found.row.left_out)} left out")
    for each in found.row.left_out:
        context.say(f"left out: {each}")
    return Plan(rounds=found.rounds)
