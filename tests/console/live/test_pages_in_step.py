"""Every open page shows the same state within 0.2 s, and a page that was opened late or reloaded sees everything."""

from __future__ import annotations

import statistics
from pathlib import Path

import pytest

from tests.helpers.console import browser, live_console, now_ms, round_trip_ms, shown_at_ms
from tests.helpers.engine import WrittenRun

EVENTS = 12
LOOK_MS = 50.0


@pytest.mark.long
@pytest.mark.parametrize("path", ["/live-test/run", "/run/run?scene=false"], ids=["smallest page", "run view"])
def test_all_pages_show_an_event_within_two_looks_and_some_round_trips_and_a_reloaded_page_shows_it_too(
    tmp_path: Path, path: str
) -> None:
    run = WrittenRun(tmp_path / "run")
    run.say("first")
    with live_console(tmp_path) as console, browser() as chromium:
        clicked = console.page(chromium)
        pages = [console.page(chromium, path) for _ in range(3)]
        for page in pages:
            shown_at_ms(page, "message", "first")
        shown, apart, trips = [], [], []
        for number in range(1, EVENTS + 1):
            began = now_ms(pages[0])
            run.say(f"event {number}")
            times = [shown_at_ms(page, "message", f"event {number}") for page in pages]
            shown.append(max(times) - began)
            apart.append(max(times) - min(times))
            trips.append(round_trip_ms(clicked, number))
        pages[0].reload()
        for page in (pages[0], console.page(chromium, path)):
            shown_at_ms(page, "message", f"event {EVENTS}")
    all_ms, apart_ms, trip_ms = (statistics.median(each) for each in (shown, apart, trips))
    print(
        f"{path}: all of 3 pages show an event after {all_ms:.0f} ms, {apart_ms:.0f} ms apart; "
        f"{all_ms / trip_ms:.1f} × a round trip"
    )
    assert all_ms < 2 * LOOK_MS + 5 * trip_ms
