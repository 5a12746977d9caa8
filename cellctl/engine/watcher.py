"""The interface for displays of a running campaign."""

from __future__ import annotations

from typing import Protocol

from cellctl.journal import KnownEvent


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
