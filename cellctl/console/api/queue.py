"""Runs that wait for their cell or their time; schedules; offers that a person confirms."""

from __future__ import annotations

from collections.abc import Awaitable
from typing import Annotated, TypeVar

from fastapi import APIRouter
from fastapi import Path as PathParameter
from pydantic import Field

from cellctl.console import queue_commands as commands
from cellctl.console.api.answers import COMMANDS, Commander, Refused
from cellctl.console.api.starting import Order, Started, text_of
from cellctl.console.run_queue import Planned, QueuedRun, Schedule
from cellctl.console.shared import console
from cellctl.files import InputError

router = APIRouter(prefix="/api", tags=["queue"])

T = TypeVar("T")
_Id = Annotated[str, PathParameter(description="`id` of the entry")]
_Weekday = Annotated[int, Field(ge=1, le=7)]


class Timed(Order):
    """A run to offer at a time of day."""

    time: str = Field(description="Local time of the console's host, `06:00`", max_length=20)
    weekdays: list[_Weekday] = Field(default=[1, 2, 3, 4, 5, 6, 7], max_length=7, description="1 is Monday")


@router.get("/queue")
async def queue() -> list[QueuedRun]:
    """The queued runs of all cells, in their order: waiting, offered, lapsed, started, removed."""
    return console().watch.queue.entries


@router.get("/schedules")
async def schedules() -> list[Schedule]:
    """Runs that are offered at a time of day."""
    return console().watch.queue.schedules


@router.post("/queue", status_code=201, responses=COMMANDS)
async def add(order: Order, operator: Commander) -> QueuedRun:
    """Check a run, and queue it: it is offered when its cell is free, and starts when a person confirms."""
    return await commands.queue(operator, _planned(order))


@router.post("/schedules", status_code=201, responses=COMMANDS)
async def add_schedule(order: Timed, operator: Commander) -> Schedule:
    """Check a run, and offer it at a time of day. It never starts by itself."""
    return await commands.schedule(operator, _planned(order), order.time, tuple(order.weekdays))


@router.post("/queue/{number}/confirm", responses=COMMANDS)
async def confirm(number: _Id, operator: Commander) -> Started:
    """Start an offered run. Only for a person who is at the cell; refused 10 minutes after the offer."""
    return Started(run=await _now(commands.confirm_offer(operator, number), number))


@router.post("/queue/{number}/offer", status_code=204, responses=COMMANDS)
async def offer_again(number: _Id, operator: Commander) -> None:
    """Let a lapsed run wait for its cell again."""
    await _now(commands.change_queue(operator, "offer again", number), number)


@router.delete("/queue/{number}", status_code=204, responses=COMMANDS)
async def remove(number: _Id, operator: Commander) -> None:
    """Take a run from the queue."""
    await _now(commands.change_queue(operator, "remove", number), number)


@router.delete("/schedules/{number}", status_code=204, responses=COMMANDS)
async def remove_schedule(number: _Id, operator: Commander) -> None:
    """End a schedule."""
    await _now(commands.change_queue(operator, "unschedule", number), number)


def _planned(order: Order) -> Planned:
    settings = {name: text_of(value) for name, value in order.settings.items()}
    cell = order.cell or commands.usual_cell(order.procedure)
    return Planned(order.procedure, cell, settings, order.seed, order.clock)


async def _now(work: Awaitable[T], number: str) -> T:
    try:
        return await work
    except LookupError:
        raise Refused(404, f"the queue has no '{number[:80]}'", "see /api/queue") from None
    except InputError as error:
        raise Refused(409, error.problems[0].what, error.problems[0].cure) from error
