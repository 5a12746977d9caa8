"""A console process with the page of `live_page`, and browser pages that note when they showed a text."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tests.helpers.console import free_port

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
    command = [sys.executable, str(Path(__file__).parent / "live_page.py"), str(runs), str(port), "token"]
    with (runs / "console.log").open("w+") as log:
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=log, text=True)
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
