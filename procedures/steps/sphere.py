"""Touching spheres: plan the touches, do one, identify the robot from all of them."""

from __future__ import annotations

import asyncio
from contextlib import suppress
from typing import Annotated, Literal

from pydantic import Field

from cellctl.devices import (
    Contact,
    ContactProbe,
    DeviceError,
    JointReadings,
    NoContact,
    SearchEnd,
    SearchingRobot,
    SearchResult,
)
from cellctl.procedure import StepContext, StepInputs, StepResult, step

Joints = Annotated[list[float], Field(min_length=1, max_length=20)]

_PROBE_PATIENCE_S = 0.2
"""How old the probe's last sign of life may be in a search before the robot holds by itself."""

_SETTLED_SHARE = 0.4
"""Transfers from guard distance on go at this share of the transfer speed: the tip is near the sphere."""


class PlanInputs(StepInputs):
    """How many touches, and on which spheres."""

    fit: Annotated[int, Field(ge=5)]
    held_out: Annotated[int, Field(ge=0)]
    spheres: list[str] = Field(default_factory=list)


class TouchPlan(StepResult):
    """One touch to come: joints in degrees, see `cellctl.planning.PlannedTouch`."""

    number: int
    sphere: str
    set: str
    approach: list[Joints]
    start: Joints
    end: Joints
    search_mm: float
    retreat: list[Joints]


class Plan(StepResult):
    """All touches, in order."""

    touches: list[TouchPlan]


@step("sphere.plan")
async def plan(context: StepContext, inputs: PlanInputs) -> Plan:
    """Plan the touches: reachable, spread over spheres and wrist orientations, by ways clear of the spheres."""
    from procedures.steps.sphere_planning import planned_touches

    touches = await asyncio.to_thread(planned_touches, context, inputs.fit, inputs.held_out, inputs.spheres)
    context.say(f"planned {len(touches)} touches: {inputs.fit} to identify from, {inputs.held_out} held out")
    return Plan(touches=[TouchPlan(**touch) for touch in touches])


class TouchInputs(StepInputs):
    """A planned touch, and how fast: tip speed of the search, percent of axis speed for transfers."""

    touch: TouchPlan
    speed_mm_s: Annotated[float, Field(gt=0, le=50)]
    transfer_percent: Annotated[float, Field(gt=0, le=100)] = 20.0


class Touched(StepResult):
    """Where contact was: joints in degrees at the contact's time."""

    joints: Joints


@step("sphere.touch", needs={"robot": SearchingRobot, "probe": ContactProbe}, moves=True)
async def touch(context: StepContext, inputs: TouchInputs) -> Touched:
    """Go to a sphere, search along the planned line until contact, note the joints at its time, retreat."""
    robot: SearchingRobot = context.device("robot")
    probe: ContactProbe = context.device("probe")
    planned = inputs.touch
    slow = inputs.transfer_percent * _SETTLED_SHARE
    for target in planned.approach:
        await robot.move(tuple(target), inputs.transfer_percent)
    start = await robot.move(tuple(planned.start), slow)
    found, contact = await _search(robot, probe, planned, start, inputs.speed_mm_s)
    await robot.move(tuple(planned.retreat[0]), slow)
    for target in planned.retreat[1:]:
        await robot.move(tuple(target), inputs.transfer_percent)
    if contact is None:
        what = f"no contact on {planned.sphere} within {planned.search_mm:.0f} mm"
        raise NoContact("probe", what, "is the sphere where the cell file says, its earth lead on, the tip clean?")
    if not contact.confirmed:
        raise NoContact("probe", f"contact on {planned.sphere} did not hold (a bounce)", "clean tip and sphere")
    joints = found.joints_at(contact.time_ns)
    await context.record("touch", _row(planned, context, joints, found, contact))
    return Touched(joints=list(joints))


async def _search(
    robot: SearchingRobot, probe: ContactProbe, planned: TouchPlan, start: JointReadings, speed_mm_s: float
) -> tuple[SearchResult, Contact | None]:
    """Search to the touch's end; the contact where there was one. The robot stands where the search ended."""
    turn = sum((b - a) ** 2 for a, b in zip(start, planned.end, strict=True)) ** 0.5
    speed_deg_s = speed_mm_s * turn / planned.search_mm
    alive = robot.guard("probe")
    await probe.arm(on_edge=robot.stop_now, on_alive=alive.beat)
    try:
        found = await robot.search(tuple(planned.end), speed_deg_s, {"probe": _PROBE_PATIENCE_S})
        contact = await probe.contact() if found.end is SearchEnd.STOPPED else None
    except BaseException:
        with suppress(DeviceError):  # what ended the search is what the operator has to hear
            await probe.disarm()
        raise
    await probe.disarm()
    return found, contact


def _row(
    planned: TouchPlan, context: StepContext, joints: JointReadings, found: SearchResult, contact: Contact
) -> dict[str, object]:
    return {
        "number": planned.number,
        "sphere": planned.sphere,
        "set": planned.set,
        "joints": [round(value, 6) for value in joints],
        "resting": list(found.resting),
        "time_ns": contact.time_ns,
        "time_sigma_ns": contact.sigma_ns,
        "tick": contact.tick,
        "bounces": contact.bounces,
        "stop_cycles": found.stop_cycles,
        "late": found.late,
        "lost": found.lost,
        "skipped": found.skipped,
        "attempt": context.attempt,
    }


class IdentifyInputs(StepInputs):
    """Which model, and whether the certified spacings of the spheres are used."""

    model: Literal["auto", "geometry"] = "auto"
    use_distances: bool = True


class Identified(StepResult):
    """The verdict on held-out touches; distances to the sphere's surface in mm."""

    verdict: str
    sentence: str


@step("sphere.identify")
async def identify(context: StepContext, inputs: IdentifyInputs) -> Identified:
    """Identify the robot from the touches, say how good it was and is on the held-out ones, write data and model."""
    from procedures.steps.sphere_identification import identify_touches

    found = await asyncio.to_thread(identify_touches, context, inputs.model, inputs.use_distances)
    await context.record("verdict", found)
    return Identified(verdict=str(found["verdict"]), sentence=str(found["sentence"]))
