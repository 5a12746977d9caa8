"""The days of an operator, a metrologist and an engineer in a browser, by keyboard alone; axe finds nothing wrong."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from cellctl.journal import OperatorAction, fold, read_journal
from cellctl.operations.run_notes import notes_of
from cellctl.report import write_report
from tests.helpers.console import ConsoleProcess, browser, console_process
from tests.helpers.engine import WrittenRun
from tests.helpers.journals import check
from tests.helpers.keyboard import Keyboard
from tests.helpers.real_data import DATA
from tests.helpers.runs import CELL, confirmed_touches, quick_cell
from tests.report.conftest import fitted, run_folder, touches_of_a_robot_with_known_errors

pytestmark = pytest.mark.long

PATIENCE_MS = 120_000
CERTIFIED = """
report:
  {customer: ACME, site: hall 3, laboratory: metrology, responsible: Ada, country: DE, sigma_mm: {artefact: 0.003}}
acceptance: [{limit_mm: 0.05, measurand: mean}]
"""
UR10 = DATA / "ur10_tracker" / "measurements_grid.csv"
ROWS = 120


@dataclass(frozen=True)
class Person:
    """Somebody at a console, whose browser has stated a name."""

    page: Any
    keys: Keyboard
    console: ConsoleProcess


@pytest.fixture(scope="module")
def console(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ConsoleProcess]:
    """A console with a calibrated and accepted robot, and daily checks of another one that has grown."""
    folder = tmp_path_factory.mktemp("days")
    runs = folder / "runs"
    run_folder(runs / "calibration", fitted(touches_of_a_robot_with_known_errors(64)), cell=CERTIFIED)
    write_report(runs / "calibration")  # decides on the acceptance limit
    for number in range(21):
        check(runs, number, grown=5e-4 * (number >= 20))
    cell = quick_cell(folder, name="sphere_hall.yaml")
    touches = confirmed_touches(folder, fit=5)
    touches.write_text(touches.read_text().replace(str(CELL), str(cell)))
    with console_process(runs, "--cell", str(cell), folder=folder) as served:
        yield served


@pytest.fixture(scope="module")
def chromium() -> Iterator[Any]:
    with browser() as found:
        yield found


@pytest.fixture
def person(console: ConsoleProcess, chromium: Any, request: pytest.FixtureRequest) -> Iterator[Person]:
    """A person who opens the printed address and states a name; 1360 or 1024 pixels wide."""
    page = chromium.new_page(viewport={"width": request.param, "height": 800})
    page.set_default_timeout(PATIENCE_MS)
    keys = Keyboard(page)
    page.goto(console.command_url)
    keys.sees_nothing_wrong()
    keys.write(page.get_by_label("Your name"), "Ada")
    page.keyboard.press("Enter")
    page.wait_for_url("**/cell")
    yield Person(page, keys, console)
    print(f"the longest way by Tab: {keys.furthest}")
    page.close()


@pytest.mark.parametrize("person", [1024], indirect=True)
def test_an_operators_day(person: Person) -> None:
    page, keys, runs = person.page, person.keys, person.console.runs
    keys.to_content()
    keys.press(page.get_by_role("button", name="Examine devices"))
    page.get_by_text("in order").first.wait_for()
    keys.sees_nothing_wrong()

    keys.opens("Start", "**/start*")
    assert "(confirmed_touches)" in page.get_by_role("combobox", name="Procedure").input_value()
    keys.to_content()
    keys.press(page.get_by_role("button", name="Check", exact=True))
    page.get_by_text("No errors. Cell 'sphere cell'").wait_for()
    keys.sees_nothing_wrong()
    keys.press(page.get_by_role("button", name="Start the run"))
    page.wait_for_url("**/run/confirmed_touches-*")
    run = runs / page.url.rpartition("/")[2]
    page.get_by_role("alert").get_by_text("Is the cell clear?").wait_for()
    page.wait_for_function("document.title.startsWith('(1) Waits for you')")
    keys.sees_nothing_wrong()
    keys.to_content()
    keys.press(page.get_by_role("button", name="Confirm", exact=True))
    page.get_by_text("Finished.", exact=True).wait_for()
    state = fold(read_journal(run))
    assert (state.state, state.started and state.started.operator) == ("finished", "Ada")
    acts = [entry.event for entry in read_journal(run) if isinstance(entry.event, OperatorAction)]
    assert [(act.action, act.operator, act.via) for act in acts] == [("confirm", "Ada", "console")]

    WrittenRun(runs / "night").end("failed")
    keys.opens(re.compile(r"Alarms \("), "**/alarms")
    keys.to_content()
    night = page.get_by_role("button", name="Acknowledge: night: failed")
    keys.press(night)
    page.get_by_role("dialog", name="Acknowledge an alarm").wait_for()
    keys.sees_nothing_wrong()
    page.keyboard.type("the probe's cable")
    keys.press(page.get_by_role("button", name="Acknowledge", exact=True))
    night.wait_for(state="detached")
    page.get_by_text("by Ada: the probe's cable").wait_for()
    keys.sees_nothing_wrong()

    result_of_the_calibration(person)
    page.get_by_text("accepted", exact=True).wait_for()
    page.get_by_text("Acceptance by ISO 14253-1").wait_for()
    keys.write(page.get_by_label("Note", exact=True), "released for production")
    keys.press(page.get_by_role("button", name="Add the note"))
    page.get_by_text("released for production").first.wait_for()
    keys.sees_nothing_wrong()
    assert [(note.operator, note.text) for note in notes_of(runs / "calibration")] == [
        ("Ada", "released for production")
    ]


def result_of_the_calibration(person: Person) -> None:
    """Find the run by its search, and open its result."""
    page, keys = person.page, person.keys
    keys.opens("Runs", "**/runs")
    keys.to_content()
    keys.write(page.get_by_label("Search"), "campaign")
    page.get_by_role("status").get_by_text("1 of ").wait_for()
    keys.sees_nothing_wrong()
    keys.opens("calibration", "**/run/calibration/result")
    keys.to_content()


@pytest.mark.skipif(not UR10.exists(), reason="needs the UR10 measurements of ../shared/data")
@pytest.mark.parametrize("person", [1360], indirect=True)
def test_a_metrologists_day(person: Person, tmp_path: Path) -> None:
    page, keys = person.page, person.keys
    heading, *rows = UR10.read_text().splitlines(keepends=True)
    data = tmp_path / "grid.csv"
    data.write_text("".join([heading, *rows[:: len(rows) // ROWS]]))
    keys.opens("Analyse", "**/analyse")
    keys.sees_nothing_wrong()
    keys.to_content()
    with page.expect_file_chooser() as chooser:
        keys.press(page.get_by_role("button", name="Choose files"))
    chooser.value.set_files(data)
    page.get_by_role("alert").get_by_text("‘Columns of the file’").wait_for()
    keys.sees_nothing_wrong()
    keys.press(page.get_by_role("button", name="Read the file again"))
    page.get_by_role("alert").get_by_text("‘Unit of the joints’ rad").wait_for()
    keys.choose(page.get_by_label("Unit of the joints"), "rad", back=True)
    keys.press(page.get_by_role("button", name="Read the file again"))
    page.wait_for_url("**/analyse/grid-*")
    page.get_by_text("Read and understood: ready to fit").wait_for()
    keys.sees_nothing_wrong()
    keys.to_content()
    keys.press(page.get_by_role("button", name="Options").first)
    keys.choose(page.get_by_label("Model"), "geometry: links")
    keys.press(page.get_by_role("button", name="Fit", exact=True))
    page.get_by_text("Better than nominal. Error of held-out positions").first.wait_for()
    keys.sees_nothing_wrong()
    assert '"robot"' in downloaded(person, "Download model")

    result_of_the_calibration(person)
    keys.choose(page.get_by_role("combobox", name="Export"), "Digital Calibration Certificate")
    assert "digitalCalibrationCertificate" in downloaded(person, "Download")


def downloaded(person: Person, link: str) -> str:
    """The text of the file that a link gives."""
    with person.page.expect_download() as found:
        person.keys.press(person.page.get_by_role("link", name=link, exact=True))
    return Path(found.value.path()).read_text()


@pytest.mark.parametrize("person", [1360], indirect=True)
def test_an_engineers_day(person: Person) -> None:
    page, keys = person.page, person.keys
    keys.opens("Overview", "**/overview")
    for cell in ("sphere_hall", "tracker_cell", "sphere_tracker_cell"):
        page.get_by_role("link", name=cell, exact=True).wait_for()
    keys.sees_nothing_wrong()

    keys.opens("Start", "**/start*")
    keys.to_content()
    keys.choose(page.get_by_role("combobox", name="Procedure"), "(daily_check)")
    page.wait_for_url("**/start?procedure=daily_check*")
    keys.to_content()
    keys.choose(page.get_by_role("combobox", name="Cell"), "(tracker_cell)")
    page.wait_for_url("**/start?procedure=daily_check&cell=tracker_cell")
    keys.to_content()
    keys.press(page.get_by_role("button", name="Check", exact=True))
    page.get_by_text("No errors.").wait_for()
    keys.sees_nothing_wrong()
    keys.press(page.get_by_role("button", name="Plan …"))
    page.get_by_role("dialog", name="Plan this run").wait_for()
    keys.press(page.get_by_role("radio", name="at a time of day"), "Space")
    keys.write(page.get_by_label("Time", exact=True), "0630")
    keys.press(page.get_by_role("checkbox", name="Sun"), "Space")
    keys.sees_nothing_wrong()
    keys.press(page.get_by_role("button", name="Plan", exact=True))
    page.wait_for_url("**/jobs")
    page.get_by_role("cell", name="06:30 Mon Tue Wed Thu Fri Sat", exact=False).wait_for()
    keys.sees_nothing_wrong()

    keys.opens("Fleet", "**/fleet")
    page.get_by_role("heading", name="Fleet").first.wait_for()
    keys.sees_nothing_wrong()

    keys.opens("Daily checks", "**/daily")
    page.get_by_text("20 of 20 checks").wait_for()
    signals = page.get_by_role("row").filter(has=page.get_by_role("cell", name="scale", exact=True))
    assert "beyond 3 σ" in signals.inner_text()
    keys.sees_nothing_wrong()
    keys.press(page.get_by_role("button", name="turn x"))
    page.get_by_label("moving range, mm").locator("canvas").wait_for()
    keys.sees_nothing_wrong()
