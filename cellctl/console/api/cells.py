"""Cells: their devices, emergency stop, guard and operating mode; `doctor` as a command."""

from __future__ import annotations

import asyncio
from dataclasses import asdict
from pathlib import Path

from fastapi import APIRouter
from pydantic import BaseModel, Field

from cellctl.console import commands
from cellctl.console.api.answers import COMMANDS, READS, CellName, Commander, Refused
from cellctl.console.shared import console
from cellctl.files import InputError
from cellctl.journal import fold, read_journal
from cellctl.operations.cell_state import CellState, cell_state, last_examination, last_run_on, run_on
from cellctl.operations.checking import FileChoice, choices

router = APIRouter(prefix="/api", tags=["cells"])


class CellChoice(BaseModel):
    """A cell to choose by its name."""

    name: str = Field(description="Name of the file without folder and suffix")
    file: str
    title: str = Field(description="The cell's own name")
    simulated: bool | None = Field(description="Whether its devices are simulated; null: the file is not readable")
    shipped: bool = Field(description="Whether it comes with cellctl")


class DeviceOut(BaseModel):
    """A device of a cell."""

    name: str
    address: str
    state: str = Field(description="`in order`, `failed` or `not known`")
    text: str = Field(description="What it reported of its health")
    model: str
    serial: str
    firmware: str
    latency_ms: float | None = Field(description="From a request to its answer in the cell's time, ms")
    last_error: str = Field(description="Its last failure; empty: none")
    cure: str


class CellOut(BaseModel):
    """State of a cell, from the run that is active on it, else from the last run or examination."""

    name: str
    file: str
    simulated: bool
    devices: list[DeviceOut]
    emergency_stop: str = Field(description="Chain `closed`, `open` or `not known`")
    guard: str = Field(description="`closed`, `open` or `not known`")
    mode: str = Field(description="Operating mode as the controller names it, or `not known`")
    source: str = Field(description="`run NAME`, `doctor`, or empty: nothing is known yet")
    at: str = Field(description="UTC: begin of that run if it is active, else its end; or time of that examination")
    run: str = Field(description="Run that is active on this cell; empty: none")


def cell_file(name: str) -> Path:
    """The file of a cell to choose. Raises Refused (404)."""
    found = choices("cell", console().settings.cell)
    if name not in found:
        raise Refused(404, f"there is no cell '{name}'", f"one of: {', '.join(found)}")
    return found[name].file


@router.get("/cells")
async def cells() -> list[CellChoice]:
    """The cells to choose: the console's own, those below its working folder, the shipped ones."""
    found = await asyncio.to_thread(choices, "cell", console().settings.cell)
    return [_choice(one) for one in found.values()]


@router.get("/cells/{name}", responses=READS)
async def cell(name: CellName) -> CellOut:
    """Health of each device, emergency stop, guard and operating mode."""
    return _out(await state_of(await asyncio.to_thread(cell_file, name)))


@router.post("/cells/{name}/doctor", responses=COMMANDS)
async def doctor(name: CellName, operator: Commander) -> CellOut:
    """Connect to every device and read its health; nothing moves. Refused while a run is active on the cell."""
    file = await asyncio.to_thread(cell_file, name)
    await commands.loaded_cell(file)  # an error in the file is the file's (422), any other is of this moment (409)
    try:
        await commands.examine(operator, file)
    except InputError as error:
        raise Refused(409, error.problems[0].what, error.problems[0].cure) from error
    return _out(await state_of(file))


async def state_of(file: Path) -> CellState:
    """The state of the cell in `file`. Raises InputError."""
    loaded = await commands.loaded_cell(file)

    def read() -> CellState:
        runs = console().runs
        active = run_on(file, runs)
        state = (active, fold(read_journal(runs / active))) if active else last_run_on(loaded, runs)
        return cell_state(loaded, state, last_examination(loaded, runs), active=bool(active))

    return await asyncio.to_thread(read)


def _choice(one: FileChoice) -> CellChoice:
    return CellChoice(name=one.name, file=str(one.file), title=one.title, simulated=one.simulated, shipped=one.shipped)


def _out(state: CellState) -> CellOut:
    return CellOut.model_validate({**asdict(state), "file": str(state.file)})
