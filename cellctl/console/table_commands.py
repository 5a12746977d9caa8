"""Commands about tables, for pages and API: each looks or acts in a process of its own, one at a time."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from cellctl.console.command_jobs import command_job
from cellctl.console.commands import TABLE_JOBS, being_examined
from cellctl.console.jobs import Job
from cellctl.console.shared import console
from cellctl.engine import Operator
from cellctl.files import InputError, Problem
from cellctl.operations.results import SIMULATOR_MEMORY
from cellctl.operations.run_files import run_named
from cellctl.operations.shipped import shipped_file
from cellctl.operations.table_actions import Action, TableRequest, refuse_confirmation

LOOK, ACT = TABLE_JOBS


def request_for(
    action: Action, cell: str = "", table: str = "", memory: str = "", seen: str = "", confirmed: str = ""
) -> TableRequest:
    """A request about a cell (file, shipped name; empty: that of the console). memory: of a simulated cell, the run
    whose simulated controller it continues. Raises InputError.
    """
    console_cell = console().settings.cell
    if not cell and console_cell is None:
        raise InputError(Problem("cell", 0, 0, "is not known", "choose a cell, or start the console with --cell CELL"))
    file = _cell_file(cell) if cell else console_cell
    assert file is not None
    state = run_named(console().runs, memory) / SIMULATOR_MEMORY if memory else None
    return TableRequest(action, file, console().runs, table, state=state, seen=seen, confirmed=confirmed)


def _cell_file(cell: str) -> Path:
    try:
        return shipped_file("cell", Path(cell))
    except (OSError, ValueError) as error:  # no file can have this name
        raise InputError(Problem(cell[:80], 0, 0, f"is no cell file: {error}", "choose a cell of the list")) from error


async def start_look(operator: Operator, request: TableRequest) -> Job:
    """Start looking what the request would change. Raises InputError while another table job runs."""
    return await _start(operator, LOOK, f"look at the table of {request.cell.stem}", request)


async def start_action(operator: Operator, request: TableRequest) -> Job:
    """Start the action. Raises InputError while another table job runs, and for a change that is not confirmed as the
    latest look at the controller asked for it.
    """
    return await _start(operator, ACT, f"table {request.action} on {request.cell.stem}", request)


async def _start(operator: Operator, operation: str, title: str, request: TableRequest) -> Job:
    own = replace(request, who=f"{operator.name}@{operator.host}")

    def start() -> Job:
        if operation == ACT and request.action != "verify":
            _refuse_unconfirmed(request)
        if busy := why_busy(request.cell):
            raise InputError(busy)
        change, jobs = _change(request), console().jobs
        return jobs.start(title, operation, own.to_json(), operator.name, target=change, computes=False)

    name = "table look" if operation == LOOK else f"table {request.action}"
    return await command_job(operator, name, request.table[:12] or request.cell.stem, start, **_details(request))


def why_busy(cell: Path) -> Problem | None:
    """Why the controller of `cell` can be given nothing about its tables now; None: it can."""
    if being_examined(cell):
        return Problem(str(cell), 0, 0, "its devices are being examined", "wait for the result")
    for job in console().jobs.all():
        if job.operation in TABLE_JOBS and not job.ended_already:
            what = f"is busy: {job.title}, begun by {job.operator}"
            return Problem("controller", 0, 0, what, "wait until that has ended")
    return None


def _refuse_unconfirmed(request: TableRequest) -> None:
    looks = [job for job in console().jobs.all() if (job.operation, job.state) == (LOOK, "done")]
    shown = next((job.result for job in reversed(looks) if job.target == _change(request)), None)
    if shown is None:
        raise InputError(Problem("controller", 0, 0, "was not looked at for this change", "look at it first"))
    refuse_confirmation(request.confirmed, shown["serial"], shown["target"] or "")


def _change(request: TableRequest) -> str:
    """The change that a look shows and an action makes."""
    return f"{request.action} of table {request.table or 'before'} on {request.cell}, memory {request.state}"


def _details(request: TableRequest) -> dict[str, str]:
    return {"cell": str(request.cell), "table": request.table, "seen": request.seen}
