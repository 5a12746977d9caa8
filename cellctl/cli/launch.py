"""A campaign's run: its folder and journal, the simulators where the cell is simulated, the devices, the engine."""

from __future__ import annotations

import asyncio
import getpass
import signal
from collections.abc import Awaitable, Callable
from contextlib import AsyncExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import final

from cellctl.cli.campaign import Campaign
from cellctl.cli.provenance import code_hash, versions
from cellctl.cli.simulated import SimulatedCell
from cellctl.clock import Clock, WallClock, calendar_time
from cellctl.devices import Device, Listener
from cellctl.devices.cell import ClockMode
from cellctl.engine import Engine, Mailbox, Outcome, Plan, Surround, Watcher
from cellctl.files import Document, sha256_of
from cellctl.journal import Journal, RunStarted, SourceFile


@final
@dataclass(frozen=True, slots=True)
class Options:
    """How to run: seed and clock instead of the cell file's, where runs go, what the simulators are told besides."""

    seed: int | None
    clock: ClockMode | None
    runs: Path
    simulator_extra: tuple[str, ...] = ()


async def run_campaign(campaign: Campaign, options: Options, folder: Path, watcher: Watcher) -> Outcome:
    """Run a campaign into `folder`, with its simulators where the cell is simulated. SIGINT and SIGTERM abort it.

    Raises InputError, DeviceError where the simulators do not start, JournalError where the folder cannot be written.
    """
    mailbox = Mailbox()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, mailbox.abort)
    if not campaign.cell.simulated:
        return await run_on(None, campaign, options, folder, mailbox, watcher)
    simulated = await SimulatedCell.start(campaign.cell, options.seed, options.clock, options.simulator_extra)
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
) -> Outcome:
    """Run a campaign into `folder` on a running simulated cell, or on the real one (None)."""
    clock = await simulated.clock() if simulated else WallClock()
    async with AsyncExitStack() as stack:
        stack.push_async_callback(clock.aclose)
        journal = stack.enter_context(Journal.create(folder, clock.now_ns))
        seed = options.seed if options.seed is not None else campaign.cell.seed
        journal.append(_started(campaign, options, seed))
        devices = _devices(campaign, clock, simulated)
        run = Surround(clock, seed, folder, campaign.cell.document, campaign.cell.robot_file, devices)
        plan = Plan(campaign.procedure, campaign.parameters, campaign.registry, devices)
        engine = Engine(plan, run, journal, mailbox, watcher)
        return await engine.run(_tell_targets(simulated, devices))


def _devices(campaign: Campaign, clock: Clock, simulated: SimulatedCell | None) -> dict[str, Device]:
    cell = campaign.cell
    return {
        name: campaign.drivers.open(
            name, simulated.address(name) if simulated else address, cell.surroundings(name, clock)
        )
        for name, address in cell.addresses.items()
    }


def _tell_targets(simulated: SimulatedCell | None, devices: dict[str, Device]) -> Callable[[], Awaitable[None]] | None:
    """A real controller has our address in its configuration; a simulated one is told where each driver listens."""
    if simulated is None:
        return None

    async def tell() -> None:
        for name, device in devices.items():
            if isinstance(device, Listener):
                host, port = device.listening()
                await simulated.tell({"op": "rsi_target", "device": name, "host": host, "port": port})

    return tell


def _started(campaign: Campaign, options: Options, seed: int) -> RunStarted:
    procedure, cell = campaign.procedure, campaign.cell
    return RunStarted(
        procedure=_source(procedure.document),
        cell=_source(cell.document),
        parameters=campaign.parameters,
        seed=seed,
        clock=(options.clock or cell.clock) if cell.simulated else "realtime",
        operator=getpass.getuser(),
        calendar=calendar_time(),
        code_sha256=code_hash(),
        versions=versions(),
    )


def _source(document: Document) -> SourceFile:
    return SourceFile(document.file, document.text, sha256_of(document.text))
