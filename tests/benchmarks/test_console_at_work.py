"""How soon pages show an event, and the memory of a console that has followed a long run and a day of events."""

from __future__ import annotations

import statistics
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.helpers.console import LiveConsole, browser, live_console, now_ms, round_trip_ms, shown_at_ms
from tests.helpers.engine import WrittenRun

EVENTS = 40
POINTS, DAY = 10_000, 86_400 // 2
"""A day of events: one every two seconds."""


@pytest.mark.long
def test_ten_pages_show_an_event_within_ten_times_the_time_of_one(tell, tmp_path: Path) -> None:
    run = WrittenRun(tmp_path / "run")
    run.say("first")
    medians = {}
    with live_console(tmp_path) as console, browser() as chromium:
        user = chromium.new_context()
        pages = [console.page(user)]
        for count in (1, 3, 10):
            pages += [console.page(user) for _ in range(count - len(pages))]
            clicked = console.page(user)
            shown, trips = [], []
            for number in range(1, EVENTS + 1):
                began, text = now_ms(pages[0]), f"{count} pages, event {number}"
                run.say(text)
                shown.append(max(shown_at_ms(page, "message", text) for page in pages) - began)
                trips.append(round_trip_ms(clicked, number))
            clicked.close()
            medians[count] = ours = statistics.median(shown)
            trip = statistics.median(trips)
            tell(
                f"event seen by all of {count} pages",
                f"{ours:.0f} ms, 95 %: {np.percentile(shown, 95):.0f}",
                f"round trip: {trip:.0f} ms, 95 %: {np.percentile(trips, 95):.0f}",
                f"{ours / trip:.1f} ×",
                "–",
            )
    assert medians[10] < 10 * medians[1]


@pytest.mark.long
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")
def test_memory_of_a_console_after_ten_thousand_points_and_a_day_of_events(tell, tmp_path: Path) -> None:
    run = WrittenRun(tmp_path / "run", points=POINTS)
    with live_console(tmp_path) as console, browser() as chromium:
        page = console.page(chromium)
        run.say("first")
        shown_at_ms(page, "message", "first")
        before = resident_mb(console)
        with run.unsafe():
            for number in range(POINTS):
                run.measured(number)
        run.say("all points")
        shown_at_ms(page, "message", "all points")
        points = resident_mb(console)
        with run.unsafe():
            for number in range(DAY):
                run.say(f"event {number}")
        run.say("a day")
        shown_at_ms(page, "message", "a day")
        day = resident_mb(console)
    tell("console, a page, a followed run", f"{before:.0f} MB", "–", "–", "–")
    tell(f"… of {POINTS} points", f"{points:.0f} MB", f"before: {before:.0f}", f"{points / before:.2f} ×", "–")
    tell(f"… and {DAY} events", f"{day:.0f} MB", f"before: {before:.0f}", f"{day / before:.2f} ×", "250 MB")
    assert day - before < 2 * (points - before) + 10  # a console that kept every event would hold much more


def resident_mb(console: LiveConsole) -> float:
    """Memory of the console's process, MB."""
    lines = Path(f"/proc/{console.process.pid}/status").read_text().splitlines()
    return next(int(line.split()[1]) / 1024 for line in lines if line.startswith("VmRSS"))
