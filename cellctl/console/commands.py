"""Commands of operators on cells and runs, the same for pages and API; each has its lines in the audit log."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any, Literal

from cellctl.console.command_jobs import command_job
from cellctl.console.jobs import Job
from cellctl.console.live.subscribers import Subscribers
from cellctl.console.shared import console
from cellctl.devices import DeviceBusy
from cellctl.devices.cell import Cell
from cellctl.devices.registry import DriverRegistry
from cellctl.engine import ActionName, Operator
from cellctl.files import InputError, Problem
from cellctl.journal import OperatorAction, writer_of
from cellctl.operations.acting import act
from cellctl.operations.cell_state import examine_cell
from cellctl.operations.detached import RunOrder, resume_detached, start_detached
from cellctl.operations.run_files import run_named

examinations = Subscribers()
"""Who is called when the examination of a cell (path of its file) begins or has ended."""

_examined: set[Path] = set()
"""Files of the cells whose devices are being examined now."""

TABLE_JOBS = ("look_at_table", "act_on_table")
"""Operations of jobs that connect to a controller for its tables."""


def folder_of(run: str) -> Path:
    """The folder of the run with this name in the console's folder of runs. Raises LookupError if there is none."""
    try:
        return run_named(console().runs, run)
    except InputError:
        raise LookupError(run) from None


async def act_on(operator: Operator, run: Path, name: ActionName, text: str = "") -> OperatorAction:
    """Pause, resume, abort, confirm or reset a run (`text`: reason, or path of the confirmed step).

    Raises InputError if it is refused.
    """

    async def work() -> OperatorAction:
        done = await asyncio.to_thread(asyncio.run, act(run, name, operator, text))
        if done.refused:
            raise InputError(Problem(run.name, 0, 0, f"'{name}' was refused: {done.refused}"))
        return done

    return await console().command(operator, name, run.name, work, **({"text": text} if text else {}))


async def start(operator: Operator, order: RunOrder) -> str:
    """Start a detached run; its name. Raises InputError with all errors, DeviceBusy if the cell is in use."""

    async def work() -> Path:
        await _refuse_second(order)
        return await start_detached(order, console().runs, operator.name)

    details = {"cell": str(order.cell or ""), "settings": list(order.settings)}
    return (await console().command(operator, "start", order.procedure.stem, work, **details)).name


async def retry(operator: Operator, run: Path, *, acknowledged: bool) -> None:
    """Continue a run that ended early at the step that it did not finish. Raises InputError, JournalError."""

    async def work() -> None:
        if writer_of(run):
            raise InputError(Problem(run.name, 0, 0, "this run is running", "pause or abort it"))
        await resume_detached(run, operator.name, acknowledged=acknowledged)

    await console().command(operator, "retry", run.name, work, acknowledged=acknowledged)


async def examine(operator: Operator, cell: Path) -> dict[str, Any]:
    """Examine the devices of a cell; nothing moves. Raises InputError while a run is active on it."""

    async def work() -> dict[str, Any]:
        if cell in _examined:
            raise InputError(Problem(str(cell), 0, 0, "its devices are being examined already", "wait for the result"))
        _examined.add(cell)
        examinations.call({str(cell)})
        try:
            return await examine_cell(cell, console().runs)
        finally:
            _examined.discard(cell)
            examinations.call({str(cell)})

    return await console().command(operator, "doctor", cell.stem, work)


async def recompute(operator: Operator, what: Literal["replay", "report"], run: Path) -> Job:
    """Replay a run, or write its report again, in a process of its own."""
    title, request = f"{what} of {run.name}", {"place": str(run)}
    return await command_job(
        operator, what, run.name, lambda: console().jobs.start(title, what, request, operator.name)
    )


def being_examined(cell: Path) -> bool:
    """Whether the devices of this cell are being examined now."""
    return cell in _examined


async def loaded_cell(file: Path) -> Cell:
    """A cell file, loaded in a thread. Raises InputError."""
    return await asyncio.to_thread(lambda: Cell.load(file, DriverRegistry()))


async def _refuse_second(order: RunOrder) -> None:
    """Raise DeviceBusy if devices of a real cell are in use; each run on a simulated cell has simulators of its own."""
    file = order.cell_file()
    if file is None or not file.is_file() or (await loaded_cell(file)).simulated:
        return
    if being_examined(file):
        raise DeviceBusy(str(file), "its devices are being examined", "start when that has ended")
    if any(job.operation in TABLE_JOBS and not job.ended_already for job in console().jobs.all()):
        raise DeviceBusy(str(file), "a controller's table is being looked at or changed", "start when that has ended")
    await asyncio.to_thread(order.refuse_in_use)
