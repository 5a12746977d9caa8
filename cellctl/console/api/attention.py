"""What happens: a stream of events, and alarms with their acknowledgement."""

from __future__ import annotations

from collections.abc import AsyncIterator
from typing import Annotated

from fastapi import APIRouter, Depends, Header, Query
from fastapi import Path as PathParameter
from fastapi.sse import EventSourceResponse, ServerSentEvent
from pydantic import BaseModel, Field

from cellctl.console import commands
from cellctl.console.alarms import Alarm
from cellctl.console.api.answers import COMMANDS, READS, Commander, Refusal, Refused
from cellctl.console.live.events import MOST_CLIENTS
from cellctl.console.shared import console
from cellctl.files import InputError

router = APIRouter(prefix="/api", tags=["attention"])

_RETRY_MS = 3000


class _Events(EventSourceResponse):
    media_type = None  # type: ignore[assignment] # of the refusals, which are JSON


class Words(BaseModel):
    """What a person says of an alarm."""

    words: str = Field(default="", max_length=500)


def _refuse_too_many() -> None:
    if console().watch.events.clients >= MOST_CLIENTS:
        raise Refused(429, f"{MOST_CLIENTS} programs read the events already", "close one of them")


@router.get(
    "/events",
    response_class=_Events,
    responses={**READS, 429: {"model": Refusal, "description": "Too many programs read the events"}},
    dependencies=[Depends(_refuse_too_many)],
)
async def events(
    last_event_id: Annotated[str, Header(max_length=100, description="Id of the last event that you have")] = "",
    wait: Annotated[bool, Query(description="false: end after the events that are there now")] = True,
) -> AsyncIterator[ServerSentEvent]:
    """What happens, as server-sent events, without end. A client that sends the id of its last event gets those after
    it; one that has none, or comes too late, gets `reset` first: then read the state anew, and go on.
    """
    async for event in console().watch.events.listen(last_event_id, wait=wait):
        yield ServerSentEvent(data=event.data, event=event.kind, id=event.id, retry=_RETRY_MS)


@router.get("/alarms")
async def alarms(
    standing: Annotated[bool, Query(description="Only those whose cause has not gone")] = False,
    last: Annotated[int, Query(ge=1, le=10_000, description="Number of alarms")] = 200,
) -> list[Alarm]:
    """The alarms, newest first: what, when raised, by whom acknowledged, when cleared."""
    log = console().watch.alarms
    return (log.standing if standing else log.all)[:last]


@router.post("/alarms/{number}/acknowledge", responses=COMMANDS)
async def acknowledge(
    operator: Commander, number: Annotated[str, PathParameter(description="`id` of the alarm")], said: Words
) -> Alarm:
    """Record that a person has seen the alarm. One whose cause is over, such as a failed run, clears with that."""
    try:
        return await commands.acknowledge(operator, number, said.words)
    except LookupError:
        raise Refused(404, f"there is no alarm '{number[:80]}'", "see /api/alarms") from None
    except InputError as error:
        raise Refused(409, error.problems[0].what, error.problems[0].cure) from error
