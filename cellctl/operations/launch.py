"""Runs a campaign: its folder and journal, the simulators of a simulated cell, the devices, the engine."""

from __future__ import annotations

import asyncio
import getpass
import signal
from collections.abc import Callable
from contextlib import AsyncExitStack, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import final

from cellctl.clock import Clock, WallClock, calendar_time
from cellctl.devices import DeviceError
from cellctl.devices.cell import ClockMode
from cellctl.engine import Engine, Mailbox, Operator, Outcome, Plan, Surround, Watcher
from cellctl.files import Document, sha256_of
from cellctl.journal import Journal, OperatorAction, RunResumed, RunStarted, RunState, SourceFile
from cellctl.operations.campaign import Campaign
from cellctl.operations.connected import open_devices, tell_targets
from cellctl.operations.device_locks import DeviceLocks
from cellctl.operations.parent import aborting_without, under_nohup
from cellctl.operations.provenance import code_hash, sources, versions
from cellctl.operations.results import SIMULATOR_MEMORY
from cellctl.operations.simulated import SimulatedCell
from cellctl.procedure import section_of


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
        engine = Engine(plan, run, journal, mailbox, watcher, record, meet, reset)
        return await engine.run(lambda: tell_targets(simulated, devices, clock))


def _journal(campaign: Campaign, options: Options, folder: Path, clock: Clock, seed: int, record: RunState) -> Journal:
    """The run's journal, new or continued; its first event is written and in `record`. Raises JournalError."""
    event: RunStarted | RunResumed
    if options.resumed is None:
        journal, event = Journal.create(folder, clock.now_ns), _started(campaign, options, folder.name, seed)
    else:
        journal = Journal.reopen(folder, clock.now_ns)
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
