"""The console as its users meet it: a process of its own, and a browser."""

from __future__ import annotations

import re
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

CHROMIUM = Path("/usr/bin/chromium")
_ARGUMENTS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-dev-shm-usage"]


@dataclass(frozen=True)
class ConsoleProcess:
    """A running console: its process, address (`http://127.0.0.1:PORT`), token and runs folder."""

    process: subprocess.Popen[str]
    url: str
    token: str
    runs: Path

    @property
    def command_url(self) -> str:
        """The address whose browser may give commands."""
        return f"{self.url}/?token={self.token}"


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
        if found := re.match(r"token +(\S+)", line):
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
