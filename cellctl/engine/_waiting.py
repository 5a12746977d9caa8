"""Waiting that a cancellation does not shorten, and waiting with a time limit that the error names."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager, suppress
from typing import Any

from cellctl.clock import Clock


async def ended(task: asyncio.Task[Any], on_cancel: Callable[[], object] | None = None) -> bool:
    """Wait until `task` has ended; its error stays in it. Returns whether the waiter was cancelled.

    The waiter's cancellation calls `on_cancel` and does not end the waiting: the caller raises it afterwards.
    """
    cancelled = False
    while not task.done():
        try:
            await asyncio.wait({task})
        except asyncio.CancelledError:
            cancelled = True
            if on_cancel:
                on_cancel()
    return cancelled


def error_of(task: asyncio.Task[Any]) -> BaseException | None:
    """The error of an ended task: a CancelledError if it was cancelled, None if it succeeded."""
    return asyncio.CancelledError() if task.cancelled() else task.exception()


@asynccontextmanager
async def beside(work: Coroutine[Any, Any, None], name: str) -> AsyncIterator[None]:
    """Do `work` beside the body, and cancel it at the body's end. Raises the error of a `work` that failed."""
    task = asyncio.create_task(work, name=name)
    try:
        yield
    finally:
        task.cancel()
        with suppress(asyncio.CancelledError):
            await task


@asynccontextmanager
async def timed(clock: Clock, seconds: float | None, path: str) -> AsyncIterator[None]:
    """Give the body, the step at `path`, `seconds` of the cell's time; None sets no limit.

    Raises TimeoutError with a text: that of the limit, or of a wait inside the step that ended without one.
    """
    inner: TimeoutError | None = None
    try:
        async with clock.timeout(seconds):
            try:
                yield
            except TimeoutError as error:
                inner = error
                raise
    except TimeoutError as error:
        if inner is None:
            raise TimeoutError(f"{path}: not done within {seconds:g} s") from error
        if not str(inner):
            raise TimeoutError(f"{path}: a wait inside the step took too long") from inner
        raise
