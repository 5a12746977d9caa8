"""Cells: their devices, emergency stop, guard and operating mode; `doctor` as a command."""

from __future__ import annotations

import asyncio
from pathlib import Path

from fastapi import APIRouter
from pydantic import BaseModel, Field

from cellctl.console import commands
from cellctl.console.api.answers import COMMANDS, READS, CellName, Commander, Refused
from cellctl.console.overview import CellOverview
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


@router.get("/overview")
async def overview() -> list[CellOverview]:
    """Every known cell: run, progress, last verdict, age of its calibration, alarms; those with a run first."""
    return await commands.cells_overview()


@router.get("/cells/{name}", responses=READS)
async def cell(name: CellName) -> CellState:
    """Health of each device, emergency stop, guard and operating mode."""
    return await state_of(await asyncio.to_thread(cell_file, name))


@router.post("/cells/{name}/doctor", responses=COMMANDS)
async def doctor(name: CellName, operator: Commander) -> CellState:
    """Connect to every device and read its health; nothing moves. Refused while a run is active on the cell."""
    file = await asyncio.to_thread(cell_file, name)
    await commands.loaded_cell(file)  # an error in the file is the file's (422), any other is of this moment (409)
    try:
        await commands.examine(operator, file)
    except InputError as error:
        raise Refused(409, error.problems[0].what, error.problems[0].cure) from error
    return await state_of(file)


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
