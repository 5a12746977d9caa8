"""Starting a run: procedures with their parameters, the check, the start."""

from __future__ import annotations

import asyncio
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated

from fastapi import APIRouter
from pydantic import BaseModel, Field, StringConstraints

from cellctl.console import commands
from cellctl.console.api.answers import COMMANDS, READS, Commander, ProblemOut, ProcedureName, Refused
from cellctl.console.api.cells import cell_file
from cellctl.console.shared import console
from cellctl.devices.cell import ClockMode
from cellctl.files import Problem
from cellctl.operations.checking import check, choices, form_of, line_of
from cellctl.operations.run_control import RunOrder
from cellctl.procedure import Parameter

router = APIRouter(prefix="/api", tags=["start"])


class ProcedureChoice(BaseModel):
    """A procedure to choose by its name."""

    name: str = Field(description="Name of the file without folder and suffix")
    file: str
    title: str
    cell: str = Field(description="Its default cell; empty: none")
    shipped: bool


class ParameterOut(BaseModel):
    """A parameter of a procedure."""

    name: str
    type: str = Field(description="`integer`, `number`, `text` or `flag`")
    default: int | float | str | bool | None = Field(description="null: a value is required")
    min: float | None
    max: float | None
    choices: list[str]
    unit: str
    help: str


class ProcedureOut(BaseModel):
    """A procedure to fill in."""

    name: str
    title: str
    file: str
    cell: str | None
    parameters: list[ParameterOut]
    confirms: list[str] = Field(description="Texts that an operator confirms during the run")
    problems: list[ProblemOut]


_Name = Annotated[str, StringConstraints(pattern=r"^[A-Za-z_][A-Za-z0-9_]*$", max_length=100)]
_Text = Annotated[str, StringConstraints(pattern=r"^[^\x00]*$", max_length=1000)]


class Order(BaseModel):
    """A run to check or to start."""

    procedure: str = Field(description="Name of a procedure, see /api/procedures")
    cell: str = Field(default="", description="Name of a cell, see /api/cells; empty: the procedure's")
    settings: dict[_Name, int | float | _Text | bool] = Field(
        default={},
        max_length=200,
        description="Parameter → value",
        json_schema_extra={"additionalProperties": False},
    )
    seed: int | None = Field(default=None, ge=0, lt=2**63, description="Seed of plan and simulated errors")
    clock: ClockMode | None = Field(default=None, description="Time of a simulated cell")


class PlacedProblem(ProblemOut):
    """An error with the line of the file at which it is."""

    text: str = Field(default="", description="The line of the file")


class CheckOut(BaseModel):
    """What the check found; without problems the run can start."""

    problems: list[PlacedProblem]
    warnings: list[PlacedProblem]
    cell: str
    devices: list[str]


class Started(BaseModel):
    """A run that has begun."""

    run: str = Field(description="Name of the run, and of its folder")


@router.get("/procedures")
async def procedures() -> list[ProcedureChoice]:
    """The procedures to choose: those below the console's working folder, and the shipped ones."""
    found = await asyncio.to_thread(choices, "procedure")
    return [
        ProcedureChoice(name=one.name, file=str(one.file), title=one.title, cell=one.cell, shipped=one.shipped)
        for one in found.values()
    ]


@router.get("/procedures/{name}", responses=READS)
async def procedure(name: ProcedureName) -> ProcedureOut:
    """Parameters with type, limits and unit, and the errors of the file itself."""
    form = await asyncio.to_thread(lambda: form_of(procedure_file(name)))
    return ProcedureOut(
        name=form.name,
        title=form.title,
        file=str(form.file),
        cell=str(form.cell) if form.cell else None,
        parameters=[_parameter(one) for one in form.parameters.values()],
        confirms=list(form.confirms),
        problems=[ProblemOut.of(each) for each in form.problems],
    )


@router.post("/check", responses=COMMANDS)
async def checked(order: Order, operator: Commander) -> CheckOut:
    """All errors of procedure, cell and settings, each at its line; opens no device, moves nothing."""
    given = await asyncio.to_thread(order_of, order)
    found = await check(given.procedure, given.cell, given.settings, console().runs)
    return CheckOut(
        problems=_placed(found.problems),
        warnings=_placed(found.warnings),
        cell=found.cell,
        devices=list(found.devices),
    )


@router.post("/runs", responses=COMMANDS, status_code=201)
async def start(order: Order, operator: Commander) -> Started:
    """Check, then start a run that lives on without the console; answers once its journal has begun."""
    return Started(run=await commands.start(operator, await asyncio.to_thread(order_of, order)))


def procedure_file(name: str) -> Path:
    """The file of a procedure to choose. Raises Refused (404)."""
    found = choices("procedure")
    if name not in found:
        raise Refused(404, f"there is no procedure '{name}'", f"one of: {', '.join(found)}")
    return found[name].file


def order_of(order: Order) -> RunOrder:
    """The order with the files of its names. Raises Refused (404)."""
    settings = tuple(f"{name}={text_of(value)}" for name, value in order.settings.items())
    cell = cell_file(order.cell) if order.cell else None
    return RunOrder(procedure_file(order.procedure), cell, settings, order.seed, order.clock)


def text_of(value: int | float | str | bool) -> str:
    """A setting's value as the command line takes it."""
    return str(value).lower() if isinstance(value, bool) else str(value)


def _parameter(one: Parameter) -> ParameterOut:
    return ParameterOut(
        name=one.name,
        type=one.type.value,
        default=one.default,
        min=one.min,
        max=one.max,
        choices=list(one.choices),
        unit=one.unit,
        help=one.help,
    )


def _placed(problems: Iterable[Problem]) -> list[PlacedProblem]:
    return [PlacedProblem.of(one, text=line_of(one)) for one in problems]
