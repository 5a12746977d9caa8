"""A run: begun in a new folder or resumed, with its provenance, then carried out; it ends with its parent process."""

from __future__ import annotations

import asyncio
import getpass
import os
import platform
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import AsyncExitStack, contextmanager, suppress
from dataclasses import dataclass, field, replace
from importlib import import_module
from importlib.metadata import PackageNotFoundError, entry_points, version
from importlib.util import find_spec
from pathlib import Path
from typing import cast, final

from threadpoolctl import threadpool_info

from cellctl.clock import Clock, WallClock, calendar_time
from cellctl.devices import DeviceBusy, DeviceError, DeviceUncertain
from cellctl.devices.cell import ClockMode
from cellctl.engine import Engine, Mailbox, MailboxFolder, Operator, Outcome, Plan, Surround, Watcher
from cellctl.files import Document, InputError, Problem, sha256_of
from cellctl.journal import (
    Journal,
    OperatorAction,
    RunResult,
    RunResumed,
    RunStarted,
    RunState,
    SourceFile,
    fold,
    read_journal,
    writer_of,
)
from cellctl.operations.campaign import Campaign
from cellctl.operations.cell_devices import DeviceLocks, SimulatedCell, open_devices, tell_targets
from cellctl.operations.run_folder import SIMULATOR_ERRORS, SIMULATOR_MEMORY, never_began, new_run_folder, table_line
from cellctl.operations.run_indexing import tell_index
from cellctl.procedure import section_of
from cellctl.version import __version__

_GROUPS = ("cellctl.devices", "cellctl.steps")
_NAMED = 5
"""Maximum number of changed files that are listed."""

_AT_FIRST_USE = ("scipy.optimize", "scipy.spatial", "scipy.spatial.transform", "scipy.stats")
"""What the mathematics imports inside functions: verbs that do not compute start faster without."""

_LIBRARIES = ("numpy", "scipy", "pyserial", "pydantic", "ruckig")

_LOOK_S = 0.5
"""Wall time between two checks, s: processes use wall time."""

_LOOK = (
    "Go and look: is the robot clear, does it stand where it did? Then say so with --acknowledge. Where it has been "
    "moved by hand off its planned way, the next step refuses to move it."
)


@final
@dataclass(frozen=True, slots=True)
class Options:
    """How to run: seed and clock that replace the cell file's, and further simulator settings.

    `resumed`: the journal's content so far of a resumed run; `acknowledged`: a person checked the cell.
    `parent`: the run is aborted when this process ends; None: no such process. `confirm_all`: every `confirm` step
    is confirmed at once. `asking`: the layer between engine and watcher that asks the operator at a terminal.
    `operator`: who starts or resumes the run; default: the user of this process.
    """

    seed: int | None
    clock: ClockMode | None
    simulator_extra: tuple[str, ...] = ()
    resumed: RunState | None = None
    acknowledged: bool = False
    parent: int | None = None
    confirm_all: bool = False
    asking: Callable[[Watcher, Mailbox], Watcher] | None = None
    operator: str = field(default_factory=getpass.getuser)


async def run_campaign(campaign: Campaign, options: Options, folder: Path, watcher: Watcher) -> Outcome:
    """Run a campaign into `folder`, with simulators if the cell is simulated.

    SIGINT, SIGTERM, SIGHUP (but not under nohup) and the end of the parent process abort it.
    Raises InputError, DeviceError if the simulators do not start, JournalError if the folder cannot be written;
    DeviceBusy, before journal and connections, if another process has a device of the cell.
    """
    campaign.registry.import_whole(campaign.procedure)
    if "numpy" in sys.modules:
        for name in _AT_FIRST_USE:
            import_module(name)
    mailbox = Mailbox(Operator.here("--confirm-all") if options.confirm_all else None)
    if options.asking:
        watcher = options.asking(watcher, mailbox)
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM, *([] if under_nohup() else [signal.SIGHUP])):
        operator = Operator.here(signal.Signals(number).name)
        loop.add_signal_handler(number, mailbox.abort, "aborted by the operator", operator)
    parent = Operator.here("end of the parent process")
    with (
        DeviceLocks.held(campaign.cell, campaign.drivers, run=folder.name) as locks,
        aborting_without(options.parent, lambda why: loop.call_soon_threadsafe(mailbox.abort, why, parent)),
    ):
        return await _with_simulators(campaign, options, folder, mailbox, watcher, locks)


async def _with_simulators(
    campaign: Campaign, options: Options, folder: Path, mailbox: Mailbox, watcher: Watcher, locks: DeviceLocks
) -> Outcome:
    if not campaign.cell.simulated:
        return await run_on(None, campaign, options, folder, mailbox, watcher, locks)
    memory = ("--state", str(folder / SIMULATOR_MEMORY))
    extra = (*memory, *options.simulator_extra)
    simulated = await SimulatedCell.start(campaign.cell, options.seed, options.clock, extra)
    try:
        return await run_on(simulated, campaign, options, folder, mailbox, watcher)
    finally:
        if simulated.process.poll() is not None:
            (folder / SIMULATOR_ERRORS).write_text(simulated.errors() + "\n")
        simulated.stop()


async def run_on(
    simulated: SimulatedCell | None,
    campaign: Campaign,
    options: Options,
    folder: Path,
    mailbox: Mailbox,
    watcher: Watcher,
    locks: DeviceLocks | None = None,
) -> Outcome:
    """Run a campaign into `folder` on a running simulated cell, or on the real one (None), whose `locks` are held."""
    if simulated and options.resumed:  # who continues the run has closed the guard and acknowledged the messages
        with suppress(DeviceError):  # a cause that stays is told by the device that it stops
            await simulated.reset()
    clock = await simulated.clock() if simulated else WallClock()
    async with AsyncExitStack() as stack:
        stack.push_async_callback(clock.aclose)
        seed = options.seed if options.seed is not None else campaign.cell.seed
        record = options.resumed or RunState()
        journal = stack.enter_context(_journal(campaign, options, folder, clock, seed, record))
        devices = open_devices(campaign.cell, campaign.drivers, clock, simulated)
        run = Surround(clock, seed, folder, campaign.cell.document, campaign.cell.robot_file, devices)
        plan = Plan(campaign.procedure, campaign.parameters, campaign.registry, devices)
        meet, reset = (locks.meet if locks else None), (simulated.reset if simulated else None)
        engine = Engine(
            plan, run, journal, mailbox, watcher, record, meet, reset, simulated.why_ended if simulated else str
        )
        return await engine.run(lambda: tell_targets(simulated, devices, clock))


def _journal(campaign: Campaign, options: Options, folder: Path, clock: Clock, seed: int, record: RunState) -> Journal:
    """The run's journal, new or continued; its first event is written and in `record`. Raises JournalError."""
    event: RunStarted | RunResumed
    if options.resumed is None:
        journal, event = Journal.create(folder, clock.now_ns), _started(campaign, options, folder.name, seed)
    else:
        journal = Journal.reopen(folder, clock.now_ns)
        MailboxFolder(folder).clear()
        event = RunResumed(options.operator, calendar_time(), code_hash(), versions(), options.acknowledged)
    record.apply(journal.append(event))
    if options.acknowledged:
        operator = Operator.here("--acknowledge")
        looked = OperatorAction(
            "acknowledge", options.operator, host=operator.host, via=operator.via, calendar=calendar_time()
        )
        record.apply(journal.append(looked))
    return journal


def _started(campaign: Campaign, options: Options, name: str, seed: int) -> RunStarted:
    procedure, cell, files = campaign.procedure, campaign.cell, sources()
    return RunStarted(
        procedure=_source(procedure.document),
        cell=_source(cell.document),
        parameters=campaign.parameters,
        seed=seed,
        clock=(options.clock or cell.clock) if cell.simulated else "realtime",
        operator=options.operator,
        calendar=calendar_time(),
        code_sha256=sha256_of(files),
        versions=versions(),
        robot=_robot(cell.robot_file),
        sources=files,
        name=name,
        section=section_of(campaign.procedure, campaign.registry),
    )


def _robot(file: Path) -> SourceFile:
    text = file.read_text(encoding="utf-8")
    return SourceFile(str(file), text, sha256_of(text))


def _source(document: Document) -> SourceFile:
    return SourceFile(document.file, document.text, sha256_of(document.text))


@final
@dataclass(frozen=True, slots=True)
class ResumedRun:
    """A run to resume: its folder, the campaign with its parameters, and its state."""

    folder: Path
    campaign: Campaign
    state: RunState
    seed: int
    clock: ClockMode


def resumed_run(campaign: Campaign, runs: Path, run: Path, settings: list[str], *, acknowledged: bool) -> ResumedRun:
    """The run in folder `run` (or `runs`/`run`), if it may be resumed.

    Raises InputError if there is nothing to resume, or procedure, cell, code or settings have changed;
    DeviceUncertain if a step that moves or writes was interrupted and not `acknowledged`; JournalError, also
    if a process still runs it.
    """
    folder = run if run.is_dir() else runs / run
    if writer := writer_of(folder):
        raise writer.error(folder)
    state = RunState() if never_began(folder) else fold(read_journal(folder))
    started = state.started
    if started is None:
        cure = f"start again: cellctl run {campaign.procedure.document.file}"
        raise InputError(_problem(folder, "ended before it began: nothing was moved", cure))
    if state.state == "finished":
        raise InputError(_problem(folder, "is finished: it cannot be resumed", "run the procedure anew"))
    line = table_line(state, folder)
    changed = _changes(campaign, started, settings)
    if changed:
        cure = "run the procedure anew, or put back what it was"
        cure += f"\n    {line}" if line else ""
        raise InputError([_problem(folder, text, cure) for text in changed])
    if (uncertain := uncertainty(state)) and not acknowledged:
        raise DeviceUncertain("cell", uncertain, _LOOK + (f"\n    {line}" if line else ""))
    same = replace(campaign, parameters=dict(started.parameters))
    return ResumedRun(folder, same, state, started.seed, cast("ClockMode", started.clock))


def _changes(campaign: Campaign, started: RunStarted, settings: list[str]) -> list[str]:
    changed = []
    if sha256_of(campaign.procedure.text) != started.procedure.sha256:
        changed.append(f"the procedure {started.procedure.path} has changed since")
    if sha256_of(campaign.cell.document.text) != started.cell.sha256:
        changed.append(f"the cell file {started.cell.path} has changed since")
    if started.robot and sha256_of(campaign.cell.robot_file.read_text(encoding="utf-8")) != started.robot.sha256:
        changed.append(f"the robot file {started.robot.path} has changed since")
    if code_hash() != started.code_sha256:
        changed.append(f"the code of cellctl, its drivers or steps has changed since{changed_sources(started.sources)}")
    for setting in settings:
        name = setting.partition("=")[0]
        if campaign.parameters.get(name) != started.parameters.get(name):
            changed.append(f"parameter {name} was {started.parameters.get(name)!r} in this run")
    return changed


def uncertainty(state: RunState) -> str:
    """What is uncertain about the cell after a run that nobody runs, as text; empty if nothing is."""
    if not state.uncertain:
        return ""
    moving = [step.step for step in state.steps.values() if step.moves and step.outcome in (None, "interrupted")]
    if moving:
        return f"the run was cut off in {', '.join(moving)}, which moves or writes: what it did last is not known"
    if (failed := state.unconfirmed) and not state.ended:
        return f"the run was cut off after {failed} had failed, before its devices were known to stand"
    cause = state.ended.reason.partition("\n")[0] if state.ended and state.ended.reason else "its clean-up failed"
    return f"the run ended in an uncertain state: {cause}"


def _problem(folder: Path, what: str, cure: str) -> Problem:
    return Problem(str(folder), 0, 0, f"this run {what}" if not what.startswith(("the ", "parameter")) else what, cure)


@final
@dataclass(frozen=True, slots=True)
class PreparedRun:
    """A run that is ready to begin: its campaign, its folder, and its settings."""

    campaign: Campaign
    folder: Path
    options: Options

    @property
    def table(self) -> str:
        """State of the table that a resumed run pushed before; empty if it pushed none."""
        return table_line(self.options.resumed, self.folder) if self.options.resumed else ""

    def carry_out(self, watcher: Watcher) -> tuple[Outcome, RunResult]:
        """Run it to its end; returns its outcome and its result. Raises what `run_campaign` raises."""
        began = time.monotonic()
        if self.options.resumed:
            tell_index(self.folder, resumed=True)
        try:
            outcome = asyncio.run(run_campaign(self.campaign, self.options, self.folder, watcher))
        except DeviceBusy:
            with suppress(OSError):  # nothing was begun: the folder of a new run is empty
                self.folder.rmdir()
            raise
        wall_s = time.monotonic() - began
        tell_index(self.folder)
        return outcome, result_of(self.folder, outcome, wall_s)


def result_of(folder: Path, outcome: Outcome, wall_s: float) -> RunResult:
    """The result of a run that this process ran."""
    error = str(outcome.error) if outcome.error else None
    known = {"state": outcome.state.value, "error": error, "simulated_s": outcome.seconds, "wall_s": wall_s}
    return RunResult.of(folder.name, fold(read_journal(folder)), **known)


def new_run(campaign: Campaign, runs: Path, options: Options) -> PreparedRun:
    """A new run of `campaign`, its folder made in `runs`. Raises InputError if it cannot be made."""
    return PreparedRun(campaign, new_run_folder(runs, campaign.procedure.name), options)


def run_to_resume(campaign: Campaign, runs: Path, run: Path, settings: list[str], options: Options) -> PreparedRun:
    """The run in folder `run` (or `runs`/`run`), to resume as it was begun. Raises what `resumed_run` raises."""
    found = resumed_run(campaign, runs, run, settings, acknowledged=options.acknowledged)
    options = replace(options, seed=found.seed, clock=found.clock, resumed=found.state)
    return PreparedRun(found.campaign, found.folder, options)


def versions() -> dict[str, str]:
    """Name → version: cellctl, Python and the libraries that a result depends on; platform, processor, BLAS kernel."""
    found = {"cellctl": __version__, "python": platform.python_version()}
    found |= {"platform": platform.platform(), "processor": _processor(), "BLAS": _blas()}
    for name in _LIBRARIES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "unknown"
    return found


def sources() -> dict[str, str]:
    """Every Python file of cellctl and of the packages with drivers and steps: name → SHA-256 of its content."""
    points = (point for group in _GROUPS for point in entry_points(group=group))
    packages = {"cellctl", *(point.module.partition(".")[0] for point in points)}
    files = sorted((name, file) for package in packages for name, file in _files(package))
    return {name: sha256_of(file.read_bytes()) for name, file in files}


def changed_sources(before: Mapping[str, str]) -> str:
    """`: a.py, b.py and 3 more`: the files that differ from `before`; empty if unknown."""
    now = sources() if before else {}
    names = sorted(name for name in before.keys() | now.keys() if before.get(name) != now.get(name))
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return f": {', '.join(names[:_NAMED])}{more}" if names else ""


def code_hash() -> str:
    """SHA-256 over `sources`: the same code, the same hash."""
    return sha256_of(sources())


def _processor() -> str:
    """The processor's model: linear algebra libraries choose their code by it, which affects the last digits."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    models = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(models, platform.processor() or platform.machine())


def _blas() -> str:
    """Linear algebra libraries of numpy and scipy, each with the kernel that it chose: `openblas 0.3.30 SkylakeX`.

    The processor's model does not decide the kernel alone: a library's version and OPENBLAS_CORETYPE do, too.
    """
    import numpy.linalg  # noqa: F401 - loads its library
    import scipy.linalg  # noqa: F401

    found = (each for each in threadpool_info() if each["user_api"] == "blas")
    return ", ".join(
        sorted({f"{each['internal_api']} {each['version']} {each.get('architecture', '')}" for each in found})
    )


def _files(package: str) -> Iterator[tuple[str, Path]]:
    spec = find_spec(package)
    folders = spec.submodule_search_locations if spec else None
    if spec and spec.origin and not folders:
        yield f"{package}.py", Path(spec.origin)
    for root in map(Path, folders or ()):
        for file in root.rglob("*.py"):
            yield f"{package}/{file.relative_to(root).as_posix()}", file


def parent_of_run(*, detached: bool) -> int | None:
    """The process whose end aborts a run that begins now; None if the run was started detached.

    That is: with `--detached`, by nohup (SIGHUP is ignored), or in a session of its own (setsid, a service manager).
    """
    return None if detached or under_nohup() or os.getsid(0) == os.getpid() else os.getppid()


def under_nohup() -> bool:
    """Whether this process was started by nohup: SIGHUP is ignored."""
    return signal.getsignal(signal.SIGHUP) is signal.SIG_IGN


@contextmanager
def aborting_without(parent: int | None, abort: Callable[[str], object]) -> Iterator[None]:
    """Inside this context, call `abort` once with the reason if `parent` ends, from a separate thread."""
    if parent is None:
        yield
        return
    over = threading.Event()
    watch = threading.Thread(target=_watch, args=(parent, _name_of(parent), abort, over), daemon=True)
    watch.start()
    try:
        yield
    finally:
        over.set()
        watch.join()


def _watch(parent: int, name: str, abort: Callable[[str], object], over: threading.Event) -> None:
    while not over.wait(_LOOK_S):
        if os.getppid() != parent:  # the parent id changes when the parent ends
            abort(
                f"aborted: process {parent}{name}, which started this run, has ended "
                "(start with --detached if the run is to continue without it)"
            )
            return


def _name_of(process: int) -> str:
    with suppress(OSError):
        return f" ({Path(f'/proc/{process}/comm').read_text().strip()})"
    return ""
