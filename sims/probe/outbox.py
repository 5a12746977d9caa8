"""The probe's lines: numbered, and sent again until acknowledged."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

REPEAT_NS = 50_000_000


@final
@dataclass(frozen=True, slots=True)
class Message:
    """A line to come. Its tick is added when it goes onto the wire."""

    kind: str
    seq: int
    fields: tuple[object, ...]

    def body(self, tick: int) -> str:
        """`TYPE,seq,tick,field,…`"""
        return ",".join(map(str, (self.kind, self.seq, tick, *self.fields)))


@final
class Outbox:
    """Counts the probe's lines and repeats those that the host has not acknowledged."""

    def __init__(self) -> None:
        self._next_seq = 0
        self._ready: list[Message] = []
        self._repeat_at: dict[Message, int] = {}

    def post(self, now: int, kind: str, *fields: object, once: bool = False) -> None:
        """A new line; `once`: not repeated."""
        message = Message(kind, self._next_seq, fields)
        self._next_seq = (self._next_seq + 1) % 0x10000
        self._ready.append(message)
        if not once:
            self._repeat_at[message] = now + REPEAT_NS

    def acknowledge(self, seq: int) -> None:
        """The host has the line of this number."""
        for message in [message for message in self._repeat_at if message.seq == seq]:
            del self._repeat_at[message]

    def collect(self, now: int) -> list[Message]:
        """The new lines since the last time, and those whose repetition is due."""
        for message in [message for message, due in self._repeat_at.items() if due <= now]:
            self._repeat_at[message] = now + REPEAT_NS
            self._ready.append(message)
        ready, self._ready = self._ready, []
        return ready

    @property
    def wake_at(self) -> int | None:
        """When the next repetition is due."""
        return min(self._repeat_at.values(), default=None)
