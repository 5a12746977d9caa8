"""What a person sees and does: a run that waits calls, an alarm is acknowledged, a run is planned."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from cellctl.journal import Outcome, Said, StepEnded, StepStarted
from tests.helpers.console import ConsoleProcess, browser, console_process
from tests.helpers.engine import WrittenRun

pytestmark = pytest.mark.long

PATIENCE_MS = 120_000


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[ConsoleProcess, WrittenRun]]:
    """A console over a failed run and one in progress."""
    runs = tmp_path_factory.mktemp("attention") / "runs"
    WrittenRun(runs / "failed").end("failed")
    run = WrittenRun(runs / "active")
    with console_process(runs, "--cell", "sphere_cell") as console:
        yield console, run
    run.end()


@pytest.fixture(scope="module")
def page(served: tuple[ConsoleProcess, WrittenRun]) -> Iterator[Any]:
    with browser() as chromium:
        page = chromium.new_page(viewport={"width": 1360, "height": 800})
        page.set_default_timeout(PATIENCE_MS)
        served[0].open_for_commands(page)
        yield page


def test_a_run_that_waits_calls_in_the_title_and_by_a_sound_that_a_click_allows(
    page: Any, served: tuple[ConsoleProcess, WrittenRun]
) -> None:
    console, run = served
    page.goto(f"{console.url}/overview")
    page.get_by_role("link", name="active", exact=True).wait_for()
    assert page.title() == "Overview · cellctl"
    page.get_by_role("button", name="Sound off").click()
    page.get_by_role("button", name="Sound on").wait_for()
    page.wait_for_function("Number(document.documentElement.dataset.called) >= 1")  # it lets you hear what it is
    before = page.evaluate("Number(document.documentElement.dataset.called)")
    run.add(StepStarted("clear", 1, False, "confirm"), Said("Is the cell clear?", "clear"))
    page.get_by_role("link", name="Waits for you: active: Is the cell clear?").wait_for()
    page.wait_for_function("document.title === '(1) Waits for you · Overview · cellctl'")
    page.wait_for_function("before => Number(document.documentElement.dataset.called) > before", arg=before)
    page.get_by_text("waits: Is the cell clear?").wait_for()
    run.add(StepEnded("clear", 1, Outcome.DONE))
    page.wait_for_function("document.title === 'Overview · cellctl'")


def test_an_alarm_is_acknowledged_by_keyboard_and_clears(page: Any, served: tuple[ConsoleProcess, WrittenRun]) -> None:
    page.goto(f"{served[0].url}/alarms")
    page.get_by_role("link", name="Alarms (1)").wait_for()
    page.get_by_role("button", name="Acknowledge: failed: failed").press("Enter")
    page.get_by_label("What you found or did").fill("the probe's cable")
    page.get_by_role("button", name="Acknowledge", exact=True).press("Enter")
    page.get_by_text("No alarm stands.").wait_for()
    page.get_by_text("the probe's cable", exact=False).wait_for()
    page.get_by_role("link", name="Alarms", exact=True).wait_for()


def test_a_run_is_planned_on_the_start_page_and_its_schedule_ends_on_the_page_of_the_jobs(
    page: Any, served: tuple[ConsoleProcess, WrittenRun]
) -> None:
    page.goto(f"{served[0].url}/start?procedure=daily_check&cell=tracker_cell")
    plan = page.get_by_role("button", name="Plan …")
    plan.wait_for()
    assert plan.is_disabled()
    page.get_by_role("button", name="Check", exact=True).click()
    plan.click()  # once it is enabled
    page.get_by_role("radio", name="at a time of day").click()
    page.get_by_label("Time", exact=True).fill("06:30")
    page.get_by_role("checkbox", name="Sun").click()
    page.get_by_role("button", name="Plan", exact=True).click()
    page.wait_for_url("**/jobs")
    page.get_by_role("cell", name="06:30 Mon Tue Wed Thu Fri Sat", exact=False).wait_for()
    page.get_by_role("button", name="End", exact=True).click()
    page.get_by_text("No run is offered by the clock.").wait_for()
