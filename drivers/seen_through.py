"""Work that a cancellation must not interrupt: holding the robot, activating a table."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from typing import TypeVar

_T = TypeVar("_T")


async def see_through(work: Coroutine[object, object, _T]) -> _T:
    """Run `work` to its end even if the caller is cancelled meanwhile, once or more; then raise the cancellation."""
    task = asyncio.ensure_future(work)
    cancelled: asyncio.CancelledError | None = None
    while not task.done():
        try:
            await asyncio.shield(task)
        except asyncio.CancelledError as error:
            cancelled = error
    result = task.result()
    if cancelled:
        raise cancelled
    return result
