"""A page follows the live state of the runs: it shows what changed, and no more than it can."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable

from nicegui import background_tasks, ui

from cellctl.console.shared import console

Subscribe = Callable[[Callable[[], None]], Callable[[], None]]
"""Registers a callback for an event; returns the function that ends that."""


def follow(show: Callable[[], object], run: str = "") -> None:
    """Call `show` in this page now, and after each change of `run` (empty: of any run), until the page is closed.

    Changes that come while `show` works are shown together by its next call. Let it change only what changed.
    """
    follow_event(show, lambda changed: console().live.subscribe(changed, run), run or "all runs")


def follow_event(show: Callable[[], object], subscribe: Subscribe, name: str) -> None:
    """As `follow`, for the event that `subscribe` is for. `show`: a function or a coroutine function."""
    changed, client = asyncio.Event(), ui.context.client
    changed.set()

    async def shown() -> None:
        while True:
            await changed.wait()
            changed.clear()
            try:
                with client:
                    work = show()
                    if isinstance(work, Awaitable):
                        await work
            except Exception:  # shown again with the next change
                logging.getLogger(__name__).exception("a page cannot show the live state")

    unsubscribe = subscribe(changed.set)
    task = background_tasks.create(shown(), name=f"page follows {name}")

    def end() -> None:
        unsubscribe()
        task.cancel()

    client.on_delete(end)
