"""Proves a model on a sphere outside the fit: locate it, compensate, push, stand-offs before and after."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import Field

from cellctl.devices import CompensatedRobot, ContactProbe, JointReadings, TableStore
from cellctl.procedure import CellContext, NoInputs, StepContext, StepInputs, StepResult, step
from procedures.steps.contact_search import FoundContact, Speeds, search_and_retreat
from procedures.steps.judged import Judged, Pushed, PushInputs
from procedures.steps.sphere._identification import verdict_of
from procedures.steps.sphere._standoffs import standoff_row, standoffs_and_table
from procedures.steps.sphere.plan_inputs import CompensateInputs, PlanProofInputs
from procedures.steps.sphere.planning import check_on_sphere, locating_touches, standoff_options, worth_proving
from procedures.steps.sphere.rows import ProofRow, SphereVerdict, StandOffRow
from procedures.steps.sphere.touch_plans import Round, StandOffPlan, TouchPlan
from procedures.steps.table_push import (
    push_unless_judged,
    require_in_force,
    take_back_unproved,
    withdrawn_unless_better,
)


class ProofPlan(StepResult):
    """Touches that locate the proof sphere; none if the model is no better and there is nothing to prove."""

    touches: list[TouchPlan]


def _check_located(context: CellContext, known: Mapping[str, Any]) -> None:
    check_on_sphere(context, known.get("sphere"), known.get("touches"))


@step("sphere.plan_proof", check=_check_located)
async def plan_proof(context: StepContext, inputs: PlanProofInputs) -> ProofPlan:
    """Plan the touches that locate the proof sphere, where the model has earned it."""
    if not worth_proving(context):
        context.say("the model is no better than nominal on held-out touches: nothing is compensated or pushed")
        return ProofPlan(touches=[])
    touches = await context.clock.compute(locating_touches, context, inputs.sphere, inputs.touches, inputs.tried)
    return ProofPlan(touches=touches)


class Compensation(StepResult):
    """The planned stand-offs, in rounds; the id of the table in the run folder. May be empty."""

    rounds: list[Round]
    table: str | None


def _check_standoffs(context: CellContext, known: Mapping[str, Any]) -> None:
    options = standoff_options(known["distance_mm"]) if "distance_mm" in known else None
    check_on_sphere(context, known.get("sphere"), known.get("targets"), options)


@step("sphere.compensate", check=_check_standoffs)
async def compensate(context: StepContext, inputs: CompensateInputs) -> Compensation:
    """Find the proof sphere by either model, compensate targets off it, write the table into the run folder."""
    if not worth_proving(context):
        return Compensation(rounds=[], table=None)
    found = await context.clock.compute(standoffs_and_table, context, inputs)
    await context.write_artefact("table.json", found.table)
    await context.record(found.row)
    context.say(found.sentence)
    return Compensation(rounds=found.rounds, table=found.row.table)


@step("sphere.push", needs={"robot": TableStore})
async def push(context: StepContext, inputs: PushInputs) -> Pushed:
    """Push the run's table to the controller: refused where it does not fit, read back, in force at once.

    In a procedure whose clean-up withdraws it this step is to be done again on resume (`on_resume: always`).
    """
    judged = [verdict for verdict in context.recorded(SphereVerdict) if verdict.standoff]
    return Pushed(active=await push_unless_judged(context, inputs.table, judged))


class StandOffInputs(StepInputs):
    """A planned stand-off, and its speeds: tip speed of the search, percent of axis speed for transfers."""

    target: StandOffPlan
    speed_mm_s: Annotated[float, Field(gt=0, le=50)]
    transfer_percent: Annotated[float, Field(gt=0, le=100)] = 20.0


class StoodOff(StepResult):
    """The measured error along the normal, mm: travel to contact less the intended distance."""

    error_mm: float


@step("sphere.standoff", needs={"robot": CompensatedRobot, "probe": ContactProbe})
async def standoff(context: StepContext, inputs: StandOffInputs) -> StoodOff:
    """Go to a target off the sphere, search along its normal until contact, note the travel, retreat."""
    robot: CompensatedRobot = context.device("robot")
    target, speeds = inputs.target, Speeds(inputs.speed_mm_s, inputs.transfer_percent)

    async def to_target() -> JointReadings:
        if target.row is None:
            return await robot.move(tuple(target.commanded), speeds.near_percent)
        await require_in_force(robot, context.recorded(ProofRow)[-1].table)
        return await robot.move_to_row(target.row, speeds.near_percent)

    async def record(found: FoundContact) -> StandOffRow:
        row = await context.clock.compute(standoff_row, context, target, found)
        await context.record(row)
        return row

    row = await search_and_retreat(robot, context.device("probe"), target, to_target, speeds, record)
    return StoodOff(error_mm=row.error_mm)


@step("sphere.judge", needs={"robot": TableStore}, verdict=SphereVerdict)
async def judge(context: StepContext, inputs: NoInputs) -> Judged:
    """Say how good the robot was and is, by held-out touches and stand-off; take a table back that did no good."""
    found = await context.clock.compute(verdict_of, context)
    found = await withdrawn_unless_better(context, found)
    await context.record(found)
    return Judged.of(found)


@step("sphere.withdraw", needs={"robot": TableStore})
async def withdraw(context: StepContext, inputs: NoInputs) -> None:
    """For the clean-up: take the run's table out of force where the run ended before it was proved."""
    await take_back_unproved(context, context.device("robot"))
