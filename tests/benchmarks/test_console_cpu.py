"""The console's CPU time while a run writes ten events a second and pages show it."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Any

import pytest

from tests.helpers.console import LiveConsole, browser, live_console, shown_at_ms
from tests.helpers.engine import WrittenRun

EVENTS = 25


@pytest.mark.long
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")
def test_ten_pages_cost_less_cpu_than_ten_times_one(tell, tmp_path: Path) -> None:
    run = WrittenRun(tmp_path / "run")
    with live_console(tmp_path) as console, browser() as chromium:
        user = chromium.new_context()
        pages = [console.page(user)]
        idle, one = _cpu(console, run, pages, "idle", 0), _cpu(console, run, pages, "one", 1)
        pages += [console.page(user) for _ in range(9)]
        ten = _cpu(console, run, pages, "ten", 1)
    tell("console, 10 events/s, 10 pages", f"{ten:.3f} s CPU/s", f"1 page: {one:.3f}", f"{ten / one:.1f} ×", "< 10 ×")
    tell("console, no events, 1 page", f"{idle:.3f} s CPU/s", "–", "–", "–")
    assert ten < 10 * one


def _cpu(console: LiveConsole, run: WrittenRun, pages: list[Any], name: str, each: int) -> float:
    """CPU seconds per second of wall time, with `each` events for 0.1 s, all shown by all pages at the end."""
    run.say(f"{name} begins")
    for page in pages:
        shown_at_ms(page, "message", f"{name} begins")
    cpu_s, began = console.cpu_s(), time.perf_counter()
    for number in range(EVENTS):
        for _ in range(each):
            run.say(f"{name} {number}")
        pages[0].wait_for_timeout(100)
    found = (console.cpu_s() - cpu_s) / (time.perf_counter() - began)
    run.say(f"{name} ends")
    for page in pages:
        shown_at_ms(page, "message", f"{name} ends")
    return found
