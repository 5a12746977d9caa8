"""Commands of operators on cells, runs and tables, for pages and API alike; each has its lines in the audit log."""

from __future__ import annotations

import asyncio
import shutil
import tempfile
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Literal, TypeVar

from cellctl.console.alarms import Alarm
from cellctl.console.jobs import Job
from cellctl.console.live.runs import Subscribers
from cellctl.console.overview import CellOverview, KnownCell, known_cells, last_run_of, overview, rows_of_cells
from cellctl.console.shared import console
from cellctl.devices import DeviceBusy
from cellctl.devices.cell import Cell
from cellctl.devices.registry import DriverRegistry
from cellctl.engine import ActionName, Operator
from cellctl.files import InputError, Problem
from cellctl.installed import shipped_file
from cellctl.journal import OperatorAction, host_of, writer_of
from cellctl.operations.cell_state import cell_state, examine_cell, last_examination
from cellctl.operations.export import Form
from cellctl.operations.presets import delete_preset, keep_preset
from cellctl.operations.results import Failure, as_json, from_json
from cellctl.operations.run_control import RunOrder, act, resume_detached, start_detached
from cellctl.operations.run_folder import SIMULATOR_MEMORY, run_named
from cellctl.operations.run_indexing import summary_of
from cellctl.operations.run_list import RunSummary
from cellctl.operations.run_notes import Note, add_note
from cellctl.operations.table_actions import Action, TableLook, TableRequest, refuse_confirmation
from cellctl.run_index import RunFilter, RunIndex

T = TypeVar("T")

_tasks: set[asyncio.Task[None]] = set()


async def command_job(
    operator: Operator,
    name: str,
    target: str,
    start: Callable[[], Job],
    refuse: Callable[[], Awaitable[None]] | None = None,
    **details: Any,
) -> Job:
    """Give the command `name` for `target`: `start` starts its job, which is returned as soon as it runs.

    Raises what `start` raises, and before it `refuse`. The command ends in the audit log when the job ends.
    """
    started: asyncio.Future[Job] = asyncio.get_running_loop().create_future()

    async def work() -> None:
        if refuse:
            await refuse()
        job = start()
        started.set_result(job)
        await result_of(job)

    task = asyncio.create_task(console().command(operator, name, target, work, **details))
    _tasks.add(task)
    task.add_done_callback(_forget)
    await asyncio.wait((task, started), return_when=asyncio.FIRST_COMPLETED)
    if not started.done():
        await task
    return started.result()


async def result_of(job: Job) -> Any:
    """The result of `job`, at its end. Raises InputError if it failed, with its problems, or was cancelled."""
    await job.ended()
    if job.state == "done":
        return job.result
    if job.state == "cancelled":
        raise InputError(Problem(job.title, 0, 0, "was cancelled", "try again"))
    failure = job.failure or Failure.internal(job.state)
    raise InputError(failure.problems, failure.note)


async def all_audited() -> None:
    """Wait until every command given so far has ended, and the audit log has its outcome."""
    await asyncio.gather(*_tasks, return_exceptions=True)


def _forget(task: asyncio.Task[None]) -> None:
    """Drop an ended task; its error is in the audit log, and in the job."""
    _tasks.discard(task)
    if not task.cancelled():
        task.exception()


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
        _refuse_other_host(run)
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
        _refuse_other_host(run)
        if writer_of(run):
            raise InputError(Problem(run.name, 0, 0, "this run is running", "pause or abort it"))
        await resume_detached(run, operator.name, acknowledged=acknowledged)

    await console().command(operator, "retry", run.name, work, acknowledged=acknowledged)


async def note(operator: Operator, run: Path, text: str) -> Note:
    """Note `text` on a run. Raises InputError, OSError."""

    async def work() -> Note:
        return await asyncio.to_thread(add_note, run, operator, text)

    return await console().command(operator, "note", run.name, work)


async def change_presets(operator: Operator, procedure: str, name: str, settings: Mapping[str, str] | None) -> None:
    """Keep `settings` as the preset `name` of a procedure; None: delete it. Raises InputError, OSError."""

    async def work() -> None:
        if settings is None:
            await asyncio.to_thread(delete_preset, console().runs, procedure, name)
        else:
            await asyncio.to_thread(keep_preset, console().runs, procedure, name, settings, operator.name)

    what = "delete preset" if settings is None else "keep preset"
    await console().command(operator, what, procedure, work, preset=name, settings=dict(settings or {}))


async def examine(operator: Operator, cell: Path) -> None:
    """Examine the devices of a cell; nothing moves. Raises InputError while a run is active on it."""

    async def work() -> None:
        await _refuse_cell_elsewhere(cell)
        if cell in _examined:
            raise InputError(Problem(str(cell), 0, 0, "its devices are being examined already", "wait for the result"))
        _examined.add(cell)
        examinations.call({str(cell)})
        try:
            await examine_cell(cell, console().runs)
            loaded = await loaded_cell(cell)
            found = await asyncio.to_thread(last_examination, loaded, console().runs)
            await console().watch.examined(cell.stem, cell_state(loaded, None, found).devices)
        finally:
            _examined.discard(cell)
            examinations.call({str(cell)})

    await console().command(operator, "doctor", cell.stem, work)


async def recompute(operator: Operator, what: Literal["replay", "report"], run: Path) -> Job:
    """Replay a run, or write its report again, in a process of its own."""
    title, request = f"{what} of {run.name}", {"place": str(run)}
    return await command_job(
        operator, what, run.name, lambda: console().jobs.start(title, what, request, operator.name)
    )


def _refuse_other_host(run: Path) -> None:
    """A cell is commanded from its own host alone: that one is beside it, and has its devices."""
    own, host = console().watch.host, host_of(run)
    if host not in ("", own):
        what = f"this run is of {host}, and this console runs on {own}: a cell is commanded from its own host alone"
        raise InputError(Problem(run.name, 0, 0, what, f"use the console on {host}"))


async def _refuse_cell_elsewhere(cell: Path) -> None:
    """As `_refuse_other_host`: a real cell is where the last run on it was. Raises InputError."""
    if (await loaded_cell(cell)).simulated:
        return
    own = console().watch.host
    run = await asyncio.to_thread(last_run_of, console().live.index, cell)
    host = host_of(console().runs / run) if run else ""
    if host not in ("", own):
        what = f"this cell is of {host} (run {run}), and this console runs on {own}"
        cure = f"use the console on {host}; if the cell is at {own} now, start the next run there by `cellctl run`"
        raise InputError(Problem(str(cell), 0, 0, what, cure))


def being_examined(cell: Path) -> bool:
    """Whether the devices of this cell are being examined now."""
    return cell in _examined


async def cells_overview() -> list[CellOverview]:
    """All known cells; runs that are not read yet are missing."""
    live, watch = console().live, console().watch
    active = [live.run(name).snapshot for name in live.active]

    def found() -> tuple[list[KnownCell], dict[str, str]]:
        cells = known_cells(console().settings.cell, rows_of_cells(live.index))
        runs = {*(each.run for each in active), *(cell.last.run for cell in cells if cell.last)}
        return cells, {run: host_of(console().runs / run) for run in runs}

    cells, hosts = await asyncio.to_thread(found)
    return overview(cells, active, watch.alarms.standing, hosts)


async def acknowledge(operator: Operator, number: str, words: str = "") -> Alarm:
    """Record that a person has seen an alarm. Raises LookupError, InputError, OSError."""
    watch = console().watch
    return await console().command(
        operator, "acknowledge", number, lambda: watch.alarms.acknowledge(number, operator, words)
    )


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
    await _refuse_cell_elsewhere(file)
    await asyncio.to_thread(order.refuse_in_use)


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
        return jobs.start(title, operation, as_json(own), operator.name, target=change, computes=False)

    name = "table look" if operation == LOOK else f"table {request.action}"
    refuse = partial(_refuse_cell_elsewhere, request.cell)
    return await command_job(
        operator, name, request.table[:12] or request.cell.stem, start, refuse, **_details(request)
    )


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
    look = from_json(TableLook, shown)
    refuse_confirmation(request.confirmed, look.serial, look.target or "")


def _change(request: TableRequest) -> str:
    """The change that a look shows and an action makes."""
    return f"{request.action} of table {request.table or 'before'} on {request.cell}, memory {request.state}"


def _details(request: TableRequest) -> dict[str, str]:
    return {"cell": str(request.cell), "table": request.table, "seen": request.seen}


REPORT_CONTENT = (
    "default-src 'none'; style-src 'unsafe-inline'; img-src data:; font-src data:; base-uri 'none'; "
    "form-action 'none'; frame-ancestors 'self'; sandbox"
)
"""Content-Security-Policy of a report: a page without scripts, which loads nothing."""


async def indexed(ask: Callable[[RunIndex], T], *, wait: bool = True) -> T:
    """What `ask`, called in a thread, answers by the index of the runs. wait: until it is complete, some seconds."""
    live = console().live
    if wait:
        await live.indexed()
    return await asyncio.to_thread(lambda: ask(live.index))


async def found_rows(asked: RunFilter | None = None, *, offset: int = 0, limit: int | None = None) -> list[RunSummary]:
    """The runs as `asked`, newest first, from number `offset` on."""
    found = await indexed(lambda index: index.page(asked, offset=offset, limit=limit))
    return [summary_of(each) for each in found]


async def exported(place: Path, form: Form) -> tuple[Path, str]:
    """A new file with the export of the run in `place`, made by a process of its own, and the name to save it by.

    The caller removes the file's folder. Raises InputError if the run cannot be exported.
    """
    folder = Path(await asyncio.to_thread(tempfile.mkdtemp, prefix="cellctl-export-"))
    target = folder / f"{place.name}-{form.file_name}"
    request = {"place": str(place), "form": form.value, "target": str(target)}
    job = console().jobs.start(f"export of {place.name}", "export", request, "")
    try:
        await result_of(job)
    except BaseException:
        job.cancel()
        await asyncio.to_thread(shutil.rmtree, folder, ignore_errors=True)
        raise
    return target, target.name
