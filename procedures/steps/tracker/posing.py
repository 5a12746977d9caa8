"""Plans the poses of the identification and the held-out ones, in rounds between visits to the monuments."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import Field

from cellctl.procedure import CellContext, StepContext, StepInputs, StepResult, step
from procedures.steps.tracker.plans import Round


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
    from procedures.steps.tracker.pose_planning import planned_rounds

    if {"fit", "held_out", "monuments_every", "from_both", "reflectors", "pose_file"} <= known.keys():
        planned_rounds(context, PlanInputs.model_validate(dict(known)), None)


def _passes(known: Mapping[str, Any]) -> int:
    poses = round(known.get("fit", 0) * (1.0 + known.get("from_both", 0.0)) + known.get("held_out", 0))
    return int(poses - (-poses // max(1, known.get("monuments_every", 1))))


@step("tracker.plan", check=_check_plan, title="planning poses", expects=_passes)
async def plan(context: StepContext, inputs: PlanInputs) -> Plan:
    """Plan quasi-random poses, or take them from a file: visible, clear of floor and arm, in random order, each
    approached from a stated side."""
    from procedures.steps.tracker.pose_planning import planned_rounds
    from procedures.steps.tracker.station import base_from_instrument

    station = base_from_instrument(context)
    rounds = await context.clock.compute(planned_rounds, context, inputs, station)
    visits = sum(len(each.poses) for each in rounds)
    twice = visits - inputs.fit - inputs.held_out
    context.say(
        f"planned {inputs.fit} poses to identify from ({twice} of them from both sides) and {inputs.held_out} held out"
    )
    return Plan(rounds=rounds)
