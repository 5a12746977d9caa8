"""The console's JSON API without a socket: requests to the application, while its live state is kept up to date."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable, Coroutine, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

import httpx

from cellctl.console.live import LiveRuns
from cellctl.console.server import api_app, new_console
from cellctl.console.shared import Console, Settings
from cellctl.procedure import StepRegistry

T = TypeVar("T")
TOKEN = "secret"


class ApiClient:
    """Sends requests to an application that runs in the loop of another thread."""

    def __init__(self, console: Console, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        self._client = httpx.AsyncClient(
            transport=httpx.ASGITransport(api_app(console)), base_url="http://127.0.0.1:8090"
        )

    def get(self, path: str, **more: Any) -> httpx.Response:
        return self.done(self._client.get(path, **more))

    def post(self, path: str, **more: Any) -> httpx.Response:
        return self.done(self._client.post(path, timeout=60.0, **more))

    def done(self, work: Coroutine[Any, Any, T]) -> T:
        """The result of `work` in the application's loop."""
        return asyncio.run_coroutine_threadsafe(work, self._loop).result(60.0)


@contextmanager
def api_client(
    runs: Path, registry: Callable[[], StepRegistry] = StepRegistry.installed, cell: Path | None = None
) -> Iterator[ApiClient]:
    """The API over the folder `runs`; its token is TOKEN."""
    console = replace(new_console(Settings(runs, cell), TOKEN), live=LiveRuns(runs, registry))
    loop = asyncio.new_event_loop()
    end = asyncio.Event()

    async def follow() -> None:
        async with console.following():
            await end.wait()

    thread = threading.Thread(target=loop.run_until_complete, args=(follow(),))
    thread.start()
    try:
        yield ApiClient(console, loop)
    finally:
        loop.call_soon_threadsafe(end.set)
        thread.join(60.0)
        loop.close()
