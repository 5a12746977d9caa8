"""The steps before the cycles: model of an earlier run, the cube, its table, and the registration."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import Field

from cellctl.devices import TableStore
from cellctl.procedure import CellContext, NoInputs, StepContext, StepInputs, StepResult, step
from procedures.steps.iso9283.plans import CubeRound
from procedures.steps.iso9283.rows import IsoVerdict
from procedures.steps.pushing import PushInputs
from procedures.steps.tracker.rows import MODEL_FILE, ReadModelRow


class ReadInputs(StepInputs):
    """Folder of the run whose model compensates, or its name beside this run; empty: none."""

    run: str = ""


class ReadModel(StepResult):
    """Whether there is a model."""

    found: bool


def _check_model(context: CellContext, known: Mapping[str, Any]) -> None:
    from procedures.steps.tracker.model_reading import check_model

    check_model(context, known)


@step("iso9283.read_model", check=_check_model, reads_files=True, title="reading the model")
async def read_model(context: StepContext, inputs: ReadInputs) -> ReadModel:
    """Read the model that an earlier run identified, and record it; refuse that of another controller."""
    from procedures.steps.tracker.model_reading import read_model_of

    if inputs.run:
        await context.record(await context.clock.compute(read_model_of, context, inputs.run))
    else:
        context.say("no model is given: the robot is measured by nominal joints only")
    return ReadModel(found=bool(inputs.run))


class CycleInputs(StepInputs):
    """cycles: how many. directions: whether P1, P2, P4 are visited from three directions, too. monuments_every: poses
    between two visits to the monuments.
    """

    cycles: Annotated[int, Field(ge=2, le=200)] = 30
    directions: bool = True
    monuments_every: Annotated[int, Field(ge=5)] = 70


class PlanInputs(CycleInputs):
    """edge: of the cube, mm; centre: `x, y, z` in the base frame, mm, empty: found; reflectors: visible everywhere."""

    edge: Annotated[float, Field(ge=100, le=2000)] = 400.0
    centre: str = ""
    reflectors: Annotated[int, Field(ge=1, le=8)] = 3


class Planned(StepResult):
    """The cycles by nominal joints, in rounds."""

    rounds: list[CubeRound]


def _check_plan(context: CellContext, known: Mapping[str, Any]) -> None:
    from procedures.steps.iso9283.planning import planned

    if {"edge", "centre", "reflectors"} <= known.keys():
        planned(context, known["edge"], known["centre"], known["reflectors"])


def _passes(known: Mapping[str, Any]) -> int:
    return int(known.get("cycles", 0)) * (14 if known.get("directions") else 5)


@step("iso9283.plan", check=_check_plan, title="planning the cube", expects=_passes)
async def plan(context: StepContext, inputs: PlanInputs) -> Planned:
    """Find the ISO cube in the workspace, the reflectors visible at its five points, and plan the cycles."""
    from procedures.steps.iso9283.cycles import cube_rounds
    from procedures.steps.iso9283.planning import cube_row, planned

    cube = await context.clock.compute(planned, context, inputs.edge, inputs.centre, inputs.reflectors)
    await context.record(cube_row(cube))
    context.say(f"cube of {cube.edge:g} mm about {', '.join(f'{x:.0f}' for x in cube.centre)} mm")
    return Planned(rounds=cube_rounds(context, cube, cube.readings, inputs, by_table=False))


class Compensation(StepResult):
    """The cycles by the table, in rounds, and the table's id; empty without a model."""

    rounds: list[CubeRound]
    table: str | None


@step("iso9283.compensate", title="compensating the five points", expects=_passes)
async def compensate(context: StepContext, inputs: CycleInputs) -> Compensation:
    """Compensate the five points by the model that was read, and write their table into the run folder."""
    from procedures.steps.iso9283.planning import compensated

    models = context.recorded(ReadModelRow)
    if not models:
        return Compensation(rounds=[], table=None)
    await context.write_artefact(MODEL_FILE, models[-1].text)
    table, rounds = await context.clock.compute(compensated, context, inputs)
    await context.write_artefact("table.json", table.text())
    context.say(f"five points compensated by the model of {models[-1].run}, up to {table.max_correction_deg:.3f}°")
    return Compensation(rounds=rounds, table=table.id)


@step("iso9283.register", title="registering the base frame")
async def register(context: StepContext, inputs: NoInputs) -> None:
    """Find the instrument's place from the registration poses, which are not judged."""
    from procedures.steps.iso9283.registration import station_row

    await context.record(await context.clock.compute(station_row, context))


@step("iso9283.push", needs={"robot": TableStore}, title="pushing the table")
async def push(context: StepContext, inputs: PushInputs) -> None:
    """Push the table of the five points; to be done again on resume (`on_resume: always`)."""
    from procedures.steps.table_push import push_of_run

    if inputs.table is not None and not context.recorded(IsoVerdict):
        await push_of_run(context, inputs.table)
