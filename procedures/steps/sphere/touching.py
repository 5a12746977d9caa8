"""Touching spheres: the plans of touches, one touch, and the robot identified from all of them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import Field

from cellctl.devices import ContactProbe, SearchingRobot
from cellctl.procedure import CellContext, StepContext, StepInputs, StepResult, step
from procedures.steps.contact_search import FoundContact, Speeds, search_and_retreat
from procedures.steps.identified import write_and_record
from procedures.steps.judged import Judged
from procedures.steps.sphere._identification import identify_touches
from procedures.steps.sphere._missed import line_after_miss
from procedures.steps.sphere.plan_inputs import PlanInputs, names_of
from procedures.steps.sphere.planning import assumption, check_plan, checked, planned_touches
from procedures.steps.sphere.reference_touches import jump, reference_row, remark
from procedures.steps.sphere.rows import LocateRow, ReferenceRow, SphereVerdict, TouchRow
from procedures.steps.sphere.touch_plans import Joints, TouchPlan


class Plan(StepResult):
    """All touches, in order; with a goal those before the first batch, and the numbers of the batches at most."""

    touches: list[TouchPlan]
    batches: list[int]


def _check_plan(context: CellContext, known: Mapping[str, Any]) -> None:
    if "spheres" in known:
        check_plan(context, known, names_of(known["spheres"]))


@step("sphere.plan", check=_check_plan)
async def plan(context: StepContext, inputs: PlanInputs) -> Plan:
    """Plan the touches: reachable, spread over spheres and wrist orientations, by ways clear of the spheres."""
    touches = await context.clock.compute(
        planned_touches,
        context,
        inputs.at_first,
        inputs.held_out_at_first,
        inputs.names,
        inputs.reference_every,
        "optimal" if inputs.goal_mm else inputs.choice,
        inputs.use_distances,
    )
    count, held_out = inputs.at_first, inputs.held_out_at_first
    context.say(f"planned {count + held_out} touches: {count} to identify from, {held_out} held out")
    context.say(await context.clock.compute(checked, context, touches, inputs.use_distances))
    if assumed := assumption(context):
        context.say(assumed)
    return Plan(touches=touches, batches=list(range(inputs.batches)))


class TouchInputs(StepInputs):
    """A planned touch, and its speeds: tip speed of the search, percent of axis speed for transfers."""

    touch: TouchPlan
    speed_mm_s: Annotated[float, Field(gt=0, le=50)]
    transfer_percent: Annotated[float, Field(gt=0, le=100)] = 20.0


class Touched(StepResult):
    """The contact: joints in degrees at the contact's time."""

    joints: Joints


@step("sphere.touch", needs={"robot": SearchingRobot, "probe": ContactProbe})
async def touch(context: StepContext, inputs: TouchInputs) -> Touched:
    """Go to a sphere, search along the planned line until contact, note the joints at its time, retreat.

    Where nothing was on that line, the touches before show the sphere's place, and the robot searches there.
    """
    robot: SearchingRobot = context.device("robot")
    probe: ContactProbe = context.device("probe")
    planned, speeds = inputs.touch, Speeds(inputs.speed_mm_s, inputs.transfer_percent)

    async def record(found: FoundContact) -> TouchRow:
        row = await context.clock.compute(_row, context, planned, found)
        await context.record(row)
        return row

    async def after_miss() -> TouchPlan | None:
        other = await context.clock.compute(line_after_miss, context, planned)
        if other:
            what = f"nothing within {planned.search_mm:.0f} mm: by the touches before, the surface is deeper"
            context.say(f"{planned.sphere}: {what}; searching there")
        return other

    row = await search_and_retreat(
        robot, probe, planned, lambda: robot.move(tuple(planned.start), speeds.near_percent), speeds, record, after_miss
    )
    if isinstance(row, ReferenceRow):
        _look_for_jump(context, row)
    return Touched(joints=list(row.joints))


def _row(context: StepContext, planned: TouchPlan, found: FoundContact) -> TouchRow:
    """Touches on the proof sphere and returns to the reference are stored separately: no fit uses them."""
    kind = LocateRow if planned.set == "locate" else TouchRow
    row = kind(
        number=planned.number,
        sphere=planned.sphere,
        set=planned.set,
        joints=tuple(round(value, 6) for value in found.joints),
        attempt=context.attempt,
        **found.row(),
    )
    if planned.repeats is None:
        return row
    return reference_row(context, row, planned.repeats)


def _look_for_jump(context: StepContext, row: ReferenceRow) -> None:
    context.say(f"reference touch: {row.shift_mm:+.3f} mm (1 σ {row.sigma_mm:.3f}) since the first visit")
    visits = context.recorded(ReferenceRow)
    if fault := jump(visits):
        raise fault
    if words := remark(visits):
        context.say(words)


class IdentifyInputs(StepInputs):
    """Which model, and whether the certified spacings of the spheres are used. goal_mm: of the campaign, 0: none."""

    model: Literal["auto", "geometry"] = "auto"
    use_distances: bool = True
    goal_mm: Annotated[float, Field(ge=0)] = 0.0


@step("sphere.identify", verdict=SphereVerdict)
async def identify(context: StepContext, inputs: IdentifyInputs) -> Judged:
    """Identify the robot from the touches, say how good it was and is on the held-out ones, write data and model."""
    found = await context.clock.compute(identify_touches, context, inputs.model, inputs.use_distances, inputs.goal_mm)
    return await write_and_record(context, found)
