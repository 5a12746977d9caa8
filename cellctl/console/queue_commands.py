"""Commands on the queue of planned runs and its schedules, for pages and API alike."""

from __future__ import annotations

import asyncio
from typing import Literal

from cellctl.console import commands
from cellctl.console.run_queue import Planned, QueuedRun, Schedule
from cellctl.console.shared import console
from cellctl.engine import Operator
from cellctl.files import InputError, Problem
from cellctl.operations.checking import check, choices
from cellctl.operations.run_control import RunOrder


def usual_cell(procedure: str) -> str:
    """The name of the cell that a procedure names. Raises InputError."""
    known = choices("procedure")
    if procedure not in known:
        what = f"there is no procedure '{procedure[:80]}'"
        raise InputError(Problem("procedure", 0, 0, what, f"one of: {', '.join(known)}"))
    if not known[procedure].cell:
        raise InputError(Problem("cell", 0, 0, f"{procedure} names no cell", "choose one"))
    return known[procedure].cell


def planned_order(planned: Planned) -> RunOrder:
    """The order with the files of its names. Raises InputError."""
    files = []
    for kind, name in (("procedure", planned.procedure), ("cell", planned.cell)):
        known = choices("procedure") if kind == "procedure" else choices("cell", console().settings.cell)
        if name not in known:
            what = f"there is no {kind} '{name[:80]}'"
            raise InputError(Problem(kind, 0, 0, what, f"one of: {', '.join(known)}"))
        files.append(known[name].file)
    settings = tuple(f"{name}={value}" for name, value in planned.settings.items())
    return RunOrder(files[0], files[1], settings, planned.seed, planned.clock)


async def queue(operator: Operator, planned: Planned, *, checked: bool = False) -> QueuedRun:
    """Queue a run: it is offered when its cell is free. checked: it was a moment ago. Raises InputError, with all
    errors of the check.
    """

    async def work() -> QueuedRun:
        if not checked:
            await _refuse_errors(planned)
        return await console().watch.queue.add(planned, operator)

    return await console().command(operator, "queue", _name_of(planned), work)


async def schedule(
    operator: Operator, planned: Planned, at: str, weekdays: tuple[int, ...], *, checked: bool = False
) -> Schedule:
    """Offer a run at a time of day. checked: it was a moment ago. Raises InputError, with all errors of the check."""

    async def work() -> Schedule:
        if not checked:
            await _refuse_errors(planned)
        return await console().watch.queue.add_schedule(planned, operator, at, weekdays)

    return await console().command(operator, "schedule", _name_of(planned), work, time=at)


async def change_queue(operator: Operator, name: Literal["remove", "offer again", "unschedule"], number: str) -> None:
    """Take a run from the queue, let a lapsed one wait again, or end a schedule. Raises LookupError, InputError."""
    queued = console().watch.queue
    work = {"remove": queued.remove, "offer again": queued.offer_again, "unschedule": queued.remove_schedule}[name]
    await console().command(operator, f"queue {name}", number, lambda: work(number, operator))


async def confirm_offer(operator: Operator, number: str) -> str:
    """Start an offered run, by a person at its cell; its name. Raises LookupError, InputError, DeviceBusy."""
    queued = console().watch.queue
    offer = queued.offer(number)
    if number in _confirmed:
        raise InputError(Problem(_name_of(offer.planned), 0, 0, "is being started already", "wait for its page"))
    _confirmed.add(number)
    try:
        run = await commands.start(operator, await asyncio.to_thread(planned_order, offer.planned))
        await queued.started(number, operator, run)
        return run
    finally:
        _confirmed.discard(number)


_confirmed: set[str] = set()
"""Offers whose runs are being started."""


async def _refuse_errors(planned: Planned) -> None:
    order = await asyncio.to_thread(planned_order, planned)
    found = await check(order.procedure, order.cell, order.settings, console().runs)
    if found.problems:
        raise InputError(found.problems)


def _name_of(planned: Planned) -> str:
    return f"{planned.procedure} on {planned.cell}"
