"""The cycles of an RSI session: a telegram in each, from RSI_ON until RSI is off."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable

from sims.kernel import Event
from sims.krc.rsi_exchange import RsiContext, RsiExchange

Ended = Callable[[str], object]
"""Takes the controller's message, empty where all went well."""


class RsiCycles(ABC):
    """From `start` until `abort`, or until it ends by itself: then `on_end` is called."""

    def __init__(self, context: RsiContext, on_end: Ended) -> None:
        self._c = context
        self._on_end = on_end
        self._exchange = RsiExchange(context, len(context.robot.joints()))
        self._next: Event | None = None

    def start(self) -> None:
        """RSI_ON, at a cycle of the grid: the first telegram leaves now."""
        self._exchange.begin()
        self._cycle(first=True)

    def abort(self) -> None:
        """RSI off, at once; the robot may be moving."""
        if self._next:
            self._next.cancel()
        self._exchange.end()

    @abstractmethod
    def _cycle(self, *, first: bool = False) -> None:
        """Take the last answer, move, and send, or end."""

    def _end(self, message: str) -> None:
        self.abort()
        self._on_end(message)

    def _send(self, now: int, end: int) -> None:
        """The telegram of the cycle that ends at `end`, ns; the next one follows then."""
        self._next = self._c.kernel.at(end, self._cycle)
        self._exchange.send(now)
