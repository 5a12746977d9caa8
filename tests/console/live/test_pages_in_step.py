"""Every open page shows each event, and a page that was opened late or reloaded sees everything.

How soon: tests/benchmarks/test_console_at_work.py, beside the round trip of a page's own button.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.helpers.console import browser, live_console, shown_at_ms
from tests.helpers.engine import WrittenRun

EVENTS = 12


@pytest.mark.long
@pytest.mark.parametrize("path", ["/live-test/run", "/run/run?scene=false"], ids=["smallest page", "run view"])
def test_all_pages_show_each_event_and_a_reloaded_page_shows_it_too(tmp_path: Path, path: str) -> None:
    run = WrittenRun(tmp_path / "run")
    run.say("first")
    with live_console(tmp_path) as console, browser() as chromium:
        pages = [console.page(chromium, path) for _ in range(3)]
        for page in pages:
            shown_at_ms(page, "message", "first")
        for number in range(1, EVENTS + 1):
            run.say(f"event {number}")
            for page in pages:
                shown_at_ms(page, "message", f"event {number}")
        pages[0].reload()
        for page in (pages[0], console.page(chromium, path)):
            shown_at_ms(page, "message", f"event {EVENTS}")
