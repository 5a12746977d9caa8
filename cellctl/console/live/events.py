"""What happens in a console, as a stream of events that a client can resume."""

from __future__ import annotations

import asyncio
import logging
from collections import deque
from collections.abc import AsyncIterator, Callable, Iterator
from dataclasses import dataclass
from typing import Any, Literal, final

Kind = Literal[
    "reset",
    "run_started",
    "run_state",
    "run_step",
    "run_progress",
    "run_waits",
    "run_ended",
    "alarm_raised",
    "alarm_acknowledged",
    "alarm_cleared",
    "cell_state",
    "job_offered",
    "job_changed",
]

KEPT = 4000
"""Number of the latest events that are kept: over three minutes of a simulated run, an hour of a real one."""

MOST_CLIENTS = 64
"""Number of programs that may read the stream at once."""


class TooManyClients(Exception):
    """As many programs as may read the stream already."""


@final
@dataclass(frozen=True, slots=True)
class Event:
    """`id`: start of the console and number, `18f3a2-17`; `data`: for JSON."""

    id: str
    number: int
    kind: Kind
    data: dict[str, Any]


@final
class EventStream:
    """The latest events of this console. Belongs to the event loop. start: differs for each start of a console.

    A client has no queue of its own, only a position in what is kept: a slow one costs nothing, and is closed when what
    it has to be sent next is kept no longer.
    """

    def __init__(self, start: str, kept: int = KEPT, most_clients: int = MOST_CLIENTS) -> None:
        self._start, self._most = start, most_clients
        self._kept: deque[Event] = deque(maxlen=kept)
        self._last = self.clients = 0
        self._published = asyncio.Event()
        self._callbacks: list[Callable[[Event], object]] = []

    def publish(self, kind: Kind, /, **data: Any) -> None:
        """Send an event to every client."""
        self._last += 1
        event = Event(self._id(self._last), self._last, kind, data)
        self._kept.append(event)
        self._published.set()
        self._published = asyncio.Event()
        for callback in self._callbacks:
            try:
                callback(event)
            except Exception:
                logging.getLogger(__name__).exception("a subscriber of the events failed")

    def subscribe(self, callback: Callable[[Event], object]) -> None:
        """Call `callback` with each event from now on. It must return at once."""
        self._callbacks.append(callback)

    async def listen(self, last_id: str = "", *, wait: bool = True) -> AsyncIterator[Event]:
        """The events after the one with `last_id`; without wait: those that are there now.

        Where these are not all kept, or `last_id` is empty or of another start, the first event is a `reset`: the
        client has to read the state anew. Ends when the client is slower than the events. Raises TooManyClients.
        """
        if self.clients >= self._most:
            raise TooManyClients
        self.clients += 1
        try:
            position = self._position(last_id)
            if position is None:
                position = self._last
                yield Event(self._id(position), position, "reset", {})
            while not self._lost(position):
                published = self._published
                for event in self._after(position):
                    yield event
                    position = event.number
                    if self._lost(position):
                        return
                if not wait:
                    return
                if position == self._last:
                    await published.wait()
        finally:
            self.clients -= 1

    def _id(self, number: int) -> str:
        return f"{self._start}-{number}"

    def _position(self, last_id: str) -> int | None:
        """The number in an id of this start whose successors are all kept; else None."""
        start, _, number = last_id.rpartition("-")
        known = start == self._start and number.isascii() and number.isdecimal() and len(number) < 20
        return int(number) if known and int(number) <= self._last and not self._lost(int(number)) else None

    def _lost(self, position: int) -> bool:
        """Whether the event after `position` is kept no longer."""
        return bool(self._kept) and position < self._kept[0].number - 1

    def _after(self, position: int) -> Iterator[Event]:
        """The kept events after `position`, as they are now."""
        found = list(self._kept)
        return iter(found[max(0, len(found) - (self._last - position)) :])
