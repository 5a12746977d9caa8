"""Passes each event of a run to its journal, its folded state and the display."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any, Protocol, final

from cellctl.clock import Clock
from cellctl.engine._waiting import timed
from cellctl.journal import (
    Journal,
    JournalError,
    KnownEvent,
    Outcome,
    RunState,
    Said,
    StepEnded,
    StepFailure,
    StepStarted,
)


class Watcher(Protocol):
    """Receives every event of the journal, and what a progress display needs besides."""

    def event(self, event: KnownEvent) -> None:
        """An event was committed."""

    def loop(self, path: str, index: int, count: int) -> None:
        """The loop at `path` begins its pass `index` (from 0) of `count`; `index` = `count`: it is done."""


class NobodyWatching:
    """A watcher that does nothing."""

    def event(self, event: KnownEvent) -> None:
        """Nothing."""

    def loop(self, path: str, index: int, count: int) -> None:
        """Nothing."""


@final
class Recorder:
    """Commits events. `state`: the journal's content; `error`: why the journal is no longer writable, else None."""

    def __init__(self, journal: Journal, state: RunState, watcher: Watcher, clock: Clock) -> None:
        self.state = state
        self.error: JournalError | None = None
        self.watcher = watcher
        self._journal = journal
        self._clock = clock

    def append(self, event: KnownEvent, *, final: bool = False) -> None:
        """Commit an event. A journal that cannot be written ends the run: no step runs unrecorded.

        With `final`, or after the first failure, the failure is stored in `error` and not raised.
        """
        if self.error is None:
            try:
                self.state.apply(self._journal.append(event))
            except JournalError as error:
                self.error = error
                if not final:
                    raise
        self.show(lambda watcher: watcher.event(event))

    def said(self, path: str, text: str) -> None:
        """A line of progress for the operator, from the step at `path`."""
        self.append(Said(text, path))

    def show(self, tell: Callable[[Watcher], None]) -> None:
        """Notify the watcher. A display that fails (terminal closed) is not called again; the campaign continues."""
        try:
            tell(self.watcher)
        except Exception:
            self.watcher = NobodyWatching()

    async def attempt(
        self, started: StepStarted, limit: float | None, body: Callable[[], Awaitable[dict[str, Any] | None]]
    ) -> dict[str, Any] | None:
        """Do `body`, an attempt at a step, within `limit` seconds (None: no limit), between its two events.

        Raises what `body` raises, TimeoutError at the limit.
        """
        path, attempt = started.step, started.attempt
        self.append(started)
        try:
            async with timed(self._clock, limit, path):
                result = await body()
        except BaseException as error:
            self.append(_failed(path, attempt, error), final=True)
            raise
        self.append(StepEnded(path, attempt, Outcome.DONE, result))
        return result


def _failed(path: str, attempt: int, error: BaseException) -> StepEnded:
    outcomes = {asyncio.CancelledError: Outcome.CANCELLED, TimeoutError: Outcome.TIMED_OUT}
    return StepEnded(path, attempt, outcomes.get(type(error), Outcome.FAILED), None, StepFailure.of(error))
