"""A page follows the live state of the runs: it shows what changed, and no more than it can."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable

from nicegui import background_tasks, ui

from cellctl.console.shared import console


def follow(show: Callable[[], object], run: str = "") -> None:
    """Call `show` in this page now, and after each change of `run` (empty: of any run), until the page is closed.

    Changes that come while `show` works are shown together by its next call. Let it change only what changed.
    """
    changed, client = asyncio.Event(), ui.context.client
    changed.set()

    async def shown() -> None:
        while True:
            await changed.wait()
            changed.clear()
            try:
                with client:
                    show()
            except Exception:  # shown again with the next change
                logging.getLogger(__name__).exception("a page cannot show the live state")

    unsubscribe = console().live.subscribe(changed.set, run)
    task = background_tasks.create(shown(), name=f"page follows {run or 'all runs'}")

    def end() -> None:
        unsubscribe()
        task.cancel()

    client.on_delete(end)
