"""Work that a cancellation must not cut short: holding the robot."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine


async def see_through(work: Coroutine[object, object, None]) -> None:
    """Run `work` to its end even where the caller is cancelled meanwhile, once or more; then let that take effect."""
    task = asyncio.ensure_future(work)
    cancelled: asyncio.CancelledError | None = None
    while not task.done():
        try:
            await asyncio.shield(task)
        except asyncio.CancelledError as error:
            cancelled = error
    task.result()
    if cancelled:
        raise cancelled
