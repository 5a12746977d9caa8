"""What an operator can say to a running campaign, from any thread or signal handler of its loop."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import final


@final
class Mailbox:
    """Pause, resume, abort: taken at the next step's border, abort at once."""

    def __init__(self) -> None:
        self._may_run = asyncio.Event()
        self._may_run.set()
        self._on_abort: Callable[[], object] | None = None
        self.aborted = False
        self.why_aborted = ""

    def pause(self) -> None:
        """Stop before the next step."""
        self._may_run.clear()

    def resume(self) -> None:
        """Go on after a pause."""
        self._may_run.set()

    def abort(self, why: str = "aborted by the operator") -> None:
        """End the campaign: cancel what runs, clean up; `why`, for who reads of it. A second abort changes nothing."""
        if not self.aborted:
            self.aborted, self.why_aborted = True, why
            self._may_run.set()
            if self._on_abort:
                self._on_abort()

    @property
    def paused(self) -> bool:
        """Is a pause asked for?"""
        return not self._may_run.is_set()

    async def may_run(self) -> None:
        """Wait while paused."""
        await self._may_run.wait()

    def when_aborted(self, callback: Callable[[], object] | None) -> None:
        """Call `callback` once at an abort; at once where it has been said already."""
        self._on_abort = callback
        if self.aborted and callback:
            callback()
