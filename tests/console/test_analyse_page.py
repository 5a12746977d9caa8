"""The page that analyses a data file, in a browser, with the measurements of a real UR10."""

from __future__ import annotations

import csv
import random
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import expect

from cellctl.formats import ModelFile
from cellctl.kinematics import abc_from_rotation
from tests.helpers.console import browser, console_process

MEASURED = Path(__file__).parents[3] / "shared" / "data" / "ur10_tracker" / "measurements_grid.csv"
JOINTS = ["shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint", "wrist_1_joint", "wrist_2_joint", "wrist_3_joint"]
PLACE = ["measurement_x", "measurement_y", "measurement_z"]
TIME_MS = 60_000

pytestmark = pytest.mark.long


def ur10_rows(count: int) -> str:
    """A data set of some rows of the real UR10."""
    if not MEASURED.exists():
        pytest.skip("needs the UR10 measurements of ../shared/data")
    with MEASURED.open(newline="") as source:
        rows = random.Random(1).sample(list(csv.DictReader(source, delimiter=";")), count)
    lines = [",".join(row[name].replace(",", ".") for name in JOINTS + PLACE) for row in rows]
    return "\n".join(["q1,q2,q3,q4,q5,q6,X,Y,Z", *lines, ""])


def instrument_rows(count: int) -> str:
    """Some rows of the real UR10, as its instrument wrote them: own headings, radians, decimal comma."""
    if not MEASURED.exists():
        pytest.skip("needs the UR10 measurements of ../shared/data")
    heading, *rows = MEASURED.read_text().splitlines(keepends=True)
    return "".join([heading, *rows[:: len(rows) // count]])


def test_a_refused_file_is_read_again_with_the_answers_that_the_page_asks_for(tmp_path: Path) -> None:
    data = tmp_path / "grid.csv"
    data.write_text(instrument_rows(40))
    with console_process(tmp_path / "runs") as console, browser() as chromium:
        page = chromium.new_page(viewport={"width": 1024, "height": 400})
        page.set_default_timeout(TIME_MS)
        console.open_for_commands(page)
        choose(page, data)
        page.get_by_role("alert").get_by_text("‘Columns of the file’").wait_for()
        named = ",".join(f"A{number}={own}" for number, own in enumerate(JOINTS, 1))
        named += ",temperature=measurement_temperature"
        expect(page.get_by_label("Columns of the file")).to_have_value(named)
        page.get_by_role("button", name="Read the file again").click()
        expect(page.get_by_role("alert").get_by_text("‘Unit of the joints’ rad")).to_be_in_viewport(timeout=TIME_MS)
        page.get_by_label("Unit of the joints").click()
        page.get_by_role("option", name="rad").click()
        page.get_by_role("button", name="Read the file again").click()
        page.wait_for_url("**/analyse/grid-*")
        assert "Universal Robots UR10" in page.locator(".facts").inner_text()


def test_an_upload_and_one_button_lead_to_verdict_report_and_downloads(tmp_path: Path) -> None:
    data = tmp_path / "ur10.csv"
    data.write_text(ur10_rows(120))
    (tmp_path / "picture.csv").write_bytes(bytes(range(256)))
    large = tmp_path / "large.csv"
    large.write_bytes(bytes(21_000_000))
    requested: set[str] = set()
    with console_process(tmp_path / "runs") as console, browser() as chromium:
        context = chromium.new_context()
        context.on("request", lambda request: requested.add(request.url))
        context.set_default_timeout(TIME_MS)
        page, other = context.new_page(), context.new_page()
        console.open_for_commands(page)
        choose(page, tmp_path / "picture.csv")
        assert page.get_by_role("alert").inner_text().split("\n")[:2] == ["picture.csv", "is not text"]
        choose(page, large)
        page.get_by_text("is larger than 20 MB").wait_for()
        with page.expect_file_chooser() as chooser:
            page.get_by_role("button", name="Choose files").press("Enter")
        chooser.value.set_files(data)
        page.wait_for_url("**/analyse/ur10-*")
        assert "Universal Robots UR10" in page.locator(".facts").inner_text()
        other.goto(page.url)
        other.wait_for_function("window.did_handshake")
        page.bring_to_front()  # a tab behind another one opens no list
        page.get_by_text("Options").first.click()
        page.get_by_label("Model").click()
        page.get_by_role("option", name="geometry: links").click()
        page.get_by_role("button", name="Fit", exact=True).click()
        other.get_by_role("progressbar").wait_for()
        for each in (page, other):
            each.get_by_text("Better than nominal. Error of held-out positions").first.wait_for()
        report = page.frame_locator("iframe")
        assert report.get_by_role("heading", name="Fit of Universal Robots UR10").is_visible()
        model = ModelFile.load(downloaded(page, "Download model"))
        assert "<robot" in downloaded(page, "Download URDF").read_text()
        targets = tmp_path / "targets.csv"
        targets.write_text(target(model, data))
        page.locator("input[type=file]").last.set_input_files(targets)
        page.get_by_role("link", name="targets-compensated.csv").wait_for()
        other.get_by_role("link", name="targets-compensated.csv").wait_for()
        other.goto(f"{console.url}/analyse")
        assert "better than nominal" in other.get_by_role("row").nth(1).inner_text()
        assert {
            url for url in requested if not url.startswith((console.url, "ws://127.0.0.1", "blob:", "data:"))
        } == set()


def test_one_click_analyses_the_simulated_example(tmp_path: Path) -> None:
    with console_process(tmp_path / "runs") as console, browser() as chromium:
        page = chromium.new_page()
        page.set_default_timeout(TIME_MS)
        console.open_for_commands(page)
        page.get_by_text("no real robot").wait_for()
        page.get_by_role("button", name="Try it with simulated data").click()
        page.wait_for_url("**/analyse/simulated_kr5_r1400-*")
        page.get_by_text("Read and understood: ready to fit").wait_for()
        facts = page.locator(".facts").inner_text()
        assert "KR5 R1400" in facts
        assert "no set-up error found" in facts


def choose(page: Any, file: Path) -> None:
    """Choose a file in the drop zone."""
    page.locator("input[type=file]").set_input_files(file)
    page.get_by_role("alert").or_(page.locator(".facts")).first.wait_for()


def downloaded(page: Any, link: str) -> Path:
    """The file behind a link."""
    with page.expect_download() as found:
        page.get_by_role("link", name=link).click()
    return Path(found.value.path())


def target(model: ModelFile, data: Path) -> str:
    """A target in the middle of the measured region: the pose of the identified robot at a measured posture."""
    joints = np.loadtxt(data, delimiter=",", skiprows=1)[:, :6]
    q = joints[np.argmin(np.abs(joints - np.median(joints, axis=0)).sum(axis=1))]
    pose = model.robot_model().chain.forward(q)
    cells = [*np.rad2deg(q), *pose[:3, 3], *abc_from_rotation(pose[:3, :3])]
    return f"A1,A2,A3,A4,A5,A6,X,Y,Z,A,B,C\n{','.join(f'{cell:.6f}' for cell in cells)}\n"
