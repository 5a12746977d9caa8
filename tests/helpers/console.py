"""The console as its users meet it: a process of its own, a browser, and its JSON API.

`live_console` is a console process with the page of `live_page`, and browser pages that note when they showed a text.
`api_client` sends requests to the application without a socket, while its live state is kept up to date.
"""

from __future__ import annotations

import asyncio
import re
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Coroutine, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

import httpx
import pytest

from cellctl.console.live import LiveRuns
from cellctl.console.server import api_app, new_console
from cellctl.console.shared import Console, Settings
from cellctl.procedure import StepRegistry

CHROMIUM = Path("/usr/bin/chromium")
_ARGUMENTS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-dev-shm-usage"]

ROOT = Path(__file__).parents[2]
_NOTE = """
window.shown = {};
addEventListener('DOMContentLoaded', () => new MutationObserver(() => {
  for (const [id, place] of [['message', '#message, .run-head .note'], ['count', '#count']]) {
    const element = document.querySelector(place);
    const key = element && `${id} ${element.textContent}`;
    if (key && !(key in window.shown)) window.shown[key] = Date.now();
  }
}).observe(document.documentElement, {childList: true, subtree: true, characterData: true}));
"""

T = TypeVar("T")
TOKEN = "secret"


@dataclass(frozen=True)
class ConsoleProcess:
    """A running console: its process, address (`http://127.0.0.1:PORT`), token (or file of users) and runs folder."""

    process: subprocess.Popen[str]
    url: str
    token: str
    runs: Path

    @property
    def command_url(self) -> str:
        """The address whose browser may give commands."""
        return f"{self.url}/?token={self.token}"

    def open_for_commands(self, page: Any, name: str = "Ada") -> None:
        """Open `command_url`, and state a name if this browser has stated none."""
        page.goto(self.command_url)
        if page.get_by_label("Your name").count():
            page.get_by_label("Your name").fill(name)
            page.get_by_label("Your name").press("Enter")
            page.wait_for_url(lambda url: "/name" not in url)


def free_port() -> int:
    """A TCP port of the loopback address that nobody uses now."""
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return int(found.getsockname()[1])


@contextmanager
def console_process(runs: Path, *options: str, port: int = 0, folder: Path | None = None) -> Iterator[ConsoleProcess]:
    """A console over the folder `runs`; `options`: further ones, such as `--cell CELL`; `folder`: where it works."""
    port = port or free_port()
    command = [sys.executable, "-P", "-m", "cellctl", "console", "--runs", str(runs), "--port", str(port), *options]
    with (runs.parent / f"console-{port}.log").open("w+") as log:
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=log, text=True, cwd=folder)
        try:
            yield _started(process, port, runs, log)
        finally:
            process.terminate()
            process.wait(30)
            assert process.stdout
            process.stdout.close()


def _started(process: subprocess.Popen[str], port: int, runs: Path, log: Any) -> ConsoleProcess:
    assert process.stdout
    for line in process.stdout:
        if found := re.match(r"(?:token|users) +(\S+)", line):
            return ConsoleProcess(process, f"http://127.0.0.1:{port}", found[1], runs)
    log.seek(0)
    raise AssertionError(f"the console ended at its start: {log.read()}")


@contextmanager
def browser() -> Iterator[Any]:
    """Debian's Chromium by playwright; skips where it is not installed."""
    if not CHROMIUM.exists():
        pytest.skip("needs /usr/bin/chromium")
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=str(CHROMIUM), args=_ARGUMENTS)
        try:
            yield chromium
        finally:
            chromium.close()


@dataclass(frozen=True)
class LiveConsole:
    """The process, and its address."""

    process: subprocess.Popen[str]
    url: str

    def cpu_s(self) -> float:
        """CPU time that the process has used so far, s; of Linux."""
        fields = Path(f"/proc/{self.process.pid}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / 100

    def page(self, chromium: Any, path: str = "/live-test/run") -> Any:
        """A new page with the run: of a new user by a browser, of the same user by a browser's context."""
        page = chromium.new_page()
        page.add_init_script(_NOTE)
        page.goto(self.url + path)
        return page


@contextmanager
def live_console(runs: Path) -> Iterator[LiveConsole]:
    """A console over the folder `runs`."""
    port = free_port()
    command = [sys.executable, "-m", "tests.helpers.live_page", str(runs.absolute()), str(port), "token"]
    with (runs / "console.log").open("w+") as log:
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=log, text=True, cwd=ROOT)
        assert process.stdout
        try:
            assert process.stdout.readline() == "listening\n", (runs / "console.log").read_text()
            yield LiveConsole(process, f"http://127.0.0.1:{port}")
        finally:
            process.terminate()
            process.wait(30)
            process.stdout.close()


def now_ms(page: Any) -> float:
    """Time of the browser, ms."""
    return float(page.evaluate("Date.now()"))


def shown_at_ms(page: Any, element: str, text: str) -> float:
    """Time of the browser when the page first showed `text` in `element`, ms; waits for it."""
    handle = page.wait_for_function("key => window.shown[key]", arg=f"{element} {text}", polling=20)
    return float(handle.json_value())


def round_trip_ms(page: Any, count: int) -> float:
    """Time from a click on the page's button to what the console answers, ms."""
    began = now_ms(page)
    page.evaluate("document.getElementById('click').click()")
    return shown_at_ms(page, "count", str(count)) - began


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

    def delete(self, path: str, **more: Any) -> httpx.Response:
        return self.done(self._client.delete(path, **more))


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
