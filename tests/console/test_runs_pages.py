"""The pages of runs and tables in a browser: search, compare, result, and a table pushed with a typed confirmation."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest

from cellctl.cli import exit_codes
from cellctl.cli.verbs import app
from tests.helpers.arms import KR5_ERRORS, kr5_model, readings_near_the_middle, targets_csv
from tests.helpers.console import ConsoleProcess, browser, console_process
from tests.helpers.journals import check, run_in

pytestmark = pytest.mark.long

SERIAL = "SIM-925185"
"""Of the shipped sphere cell's simulated controller."""
PATIENCE_MS = 60_000


def cellctl(*words: str | Path) -> None:
    assert exit_codes.exit_code_of(lambda: app([str(word) for word in words], standalone_mode=False)) == 0


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ConsoleProcess]:
    """A console over two runs of the simulated sphere cell: each has a model, the second a table and a memory."""
    runs = tmp_path_factory.mktemp("pages") / "runs"
    runs.mkdir()
    for month, a4 in ((10, 0.0), (11, 0.5)):
        place = run_in(runs, f"sphere-{month}", f"2026-{month}-01", SERIAL, cell="sphere_cell")
        kr5_model(errors={**KR5_ERRORS, "a4": a4}).save(place / "model.json")
    (place / "report.html").write_text("<h1>The report of this run</h1><script>document.title = 'script ran'</script>")
    (place / "targets.csv").write_text(targets_csv(readings_near_the_middle(8)))
    table = ("--serial", SERIAL, "-o", place / "table.json")
    cellctl("compensate", place / "model.json", place / "targets.csv", *table)
    cellctl("table", "show", "--cell", "sphere_cell", "--state", place / "simulated_cell.json", "--json", "-")
    for number in range(21):
        check(runs, number, grown=5e-4 * (number >= 20))
    for day in range(1, 5):
        run_in(runs, f"older-{day}", f"2025-01-0{day}", "111111")
    with console_process(runs, "--cell", "sphere_cell") as console:
        yield console


@pytest.fixture(scope="module")
def page(served: ConsoleProcess) -> Iterator[Any]:
    with browser() as chromium:
        page = chromium.new_page(viewport={"width": 1440, "height": 900})
        page.set_default_timeout(PATIENCE_MS)
        served.open_for_commands(page)
        yield page


def test_runs_are_searched_chosen_and_compared_by_keyboard_reachable_parts(page: Any, served: ConsoleProcess) -> None:
    page.goto(f"{served.url}/runs")
    page.get_by_text("27 of 27 runs").wait_for()
    page.get_by_label("Search").fill(SERIAL)
    page.get_by_text("2 of 27 runs").wait_for()
    for box in page.locator("tbody .q-checkbox").all():
        box.press("Space")
        box.and_(page.locator("[aria-checked=true]")).wait_for()
    page.get_by_role("link", name="Compare the two chosen runs").click()
    page.get_by_text("The models differ").wait_for()
    assert "a=sphere-10&b=sphere-11" in page.url or "b=sphere-11&a=sphere-10" in page.url
    page.get_by_role("cell", name="a4", exact=True).wait_for()


def test_the_list_is_turned_page_by_page(page: Any, served: ConsoleProcess) -> None:
    page.goto(f"{served.url}/runs")
    page.get_by_text("1-25 of 27").wait_for()
    page.locator(".q-table__bottom button").last.click()
    page.get_by_text("26-27 of 27").wait_for()
    page.get_by_role("link", name="older-1").wait_for()
    assert page.locator("tbody tr").count() == 2


def test_daily_checks_show_their_charts_and_the_signal_of_a_grown_robot(page: Any, served: ConsoleProcess) -> None:
    page.goto(f"{served.url}/daily")
    page.get_by_text("20 of 20 checks").wait_for()
    signals = page.get_by_role("row").filter(has=page.get_by_role("cell", name="scale", exact=True))
    assert "beyond 3 σ" in signals.inner_text()
    page.get_by_role("button", name="turn x").click()
    page.get_by_label("moving range, mm").locator("canvas").wait_for()


def test_a_result_shows_the_report_without_running_its_scripts(page: Any, served: ConsoleProcess) -> None:
    page.goto(f"{served.url}/run/sphere-11/result")
    report = page.frame_locator("iframe")
    report.get_by_role("heading", name="The report of this run").wait_for()
    assert page.frames[-1].title() != "script ran"
    with page.expect_download() as download:
        page.get_by_role("link", name="model.json").click()
    assert download.value.suggested_filename == "sphere-11-model.json"
    page.get_by_role("button", name="Replay").click()
    page.get_by_text("replay of sphere-11: failed").wait_for()


def test_a_table_is_pushed_and_rolled_back_only_with_the_typed_serial(page: Any, served: ConsoleProcess) -> None:
    table = json.loads((served.runs / "sphere-11" / "table.json").read_text())["id"][:12]
    page.goto(f"{served.url}/tables")
    page.get_by_role("button", name=f"Push {table}").click()
    page.get_by_role("button", name="Look at the controller").click()
    page.get_by_text("no table is in force", exact=False).first.wait_for()
    page.get_by_label("Confirmation").fill("SIM-000000")
    page.get_by_role("button", name="Push", exact=True).last.click()
    page.get_by_text("This is not the serial or the table.").wait_for()
    page.get_by_label("Confirmation").fill(SERIAL)
    page.get_by_text("This is not the serial or the table.").wait_for(state="detached")
    page.get_by_role("button", name="Push", exact=True).last.click()
    page.get_by_text(f"Table {table} is in force on {SERIAL}").wait_for()
    page.get_by_role("button", name="Close").click()
    page.get_by_text(f"{table} is in force", exact=True).wait_for()

    page.get_by_role("button", name=f"Verify {table}").click()
    page.get_by_role("button", name="Compare with the controller").click()
    page.get_by_text("all 8 rows as in the file").wait_for()
    page.get_by_role("button", name="Close").click()

    page.get_by_role("button", name="Roll back to the table before").click()
    page.get_by_role("button", name="Look at the controller").click()
    page.get_by_label("Confirmation").fill(SERIAL)
    page.get_by_role("button", name="Roll back", exact=True).click()
    page.get_by_text(f"In force on {SERIAL}: no table").wait_for()

    (history,) = httpx.get(f"{served.url}/api/tables").json()
    assert [change["action"] for change in history["changes"]] == ["rollback", "push"]
    outcomes = [
        line["outcome"] for line in httpx.get(f"{served.url}/api/audit").json() if line["command"] == "table push"
    ]
    assert outcomes == ["done"]  # the wrong confirmation was no command


def test_the_notice_of_a_busy_controller_goes_when_the_controller_is_free(page: Any, served: ConsoleProcess) -> None:
    page.goto(f"{served.url}/tables")
    page.get_by_role("button", name="Roll back to the table before").click()
    page.get_by_role("button", name="Look at the controller").dblclick()
    page.get_by_label("Confirmation").wait_for()
    page.get_by_text("is busy").wait_for(state="detached")
    (line, *_) = [line for line in httpx.get(f"{served.url}/api/audit").json() if line["outcome"] == "failed"]
    assert (line["command"], "is busy: look at the table of sphere_cell" in line["reason"]) == ("table look", True)


@pytest.mark.parametrize(
    "path", ["/tables", "/daily", "/fleet", "/run/sphere-11/result", "/compare?a=sphere-10&b=sphere-11", "/api"]
)
def test_every_table_has_a_name_and_headings_and_is_scrolled_by_keyboard(
    page: Any, served: ConsoleProcess, path: str
) -> None:
    page.goto(served.url + path)
    page.locator("table.figures").first.wait_for(state="attached")
    for table in page.locator("table.figures").all():
        region = table.locator("xpath=..")
        assert (region.get_attribute("role"), region.get_attribute("tabindex")) == ("region", "0")
        assert region.get_attribute("aria-label")
        assert table.locator("th[scope=col]").count() == table.locator("tr").first.locator("th").count() > 1
