"""Pictures of each view of the console for the documents; argument: [FOLDER].

Starts a console with the simulated sphere cell, runs a campaign from the page, and writes PNG files to the folder
(default: docs/images). Needs Debian's Chromium.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from tests.helpers.arms import kr5_model
from tests.helpers.console import ConsoleProcess, browser, console_process
from tests.helpers.journals import check, run_in
from tests.helpers.runs import ROOT

_WIDTH = 1360
NOISE = {"t": 5e-5, "a": 0.05, "d": 0.05}
DRIFTING = ("theta2", "theta3", "theta4", "theta5", "a2", "a3", "d4")
"""Parameters of the made fleet, with the σ of a run: rad for angles, mm for lengths, by their first letters."""
UR10 = ROOT.parent / "shared" / "data" / "ur10_tracker" / "measurements_grid.csv"


def main(words: Sequence[str]) -> None:
    """Write the pictures of the views to the folder."""
    folder = Path(words[0]) if words else ROOT / "docs" / "images"
    with tempfile.TemporaryDirectory() as place, browser() as chromium:
        runs = Path(place) / "runs"
        with console_process(runs, "--cell", "sphere_cell") as console:
            page = chromium.new_page(viewport={"width": _WIDTH, "height": 860})
            console.open_for_commands(page)
            _views(page, console, folder)


def _views(page: Any, console: ConsoleProcess, folder: Path) -> None:
    name = _started(page, console, folder)
    page.goto(f"{console.url}/run/{name}")
    page.get_by_text("Judging the table").wait_for()
    page.get_by_text("is in force").first.wait_for(timeout=180_000)
    _picture(page, folder / "console-run.png", 1240)
    page.goto(f"{console.url}/cell")
    page.get_by_text("in order").first.wait_for()
    _picture(page, folder / "console-cell.png", 560)
    page.goto(f"{console.url}/run/{name}")
    page.get_by_role("link", name="Result and report").wait_for(timeout=300_000)
    for view, height in (("runs", 560), ("tables", 700), (f"run/{name}/result", 900)):
        page.goto(f"{console.url}/{view}")
        page.wait_for_timeout(3000)
        _picture(page, folder / f"console-{view.rpartition('/')[2]}.png", height)
    campaign = ["run", "sphere_selfcal", "--runs", console.runs, "--set", "touches_fit=60"]
    subprocess.run([sys.executable, "-m", "cellctl", *campaign], check=True, capture_output=True)
    other = max(found.name for found in console.runs.glob("sphere_selfcal-*"))
    page.goto(f"{console.url}/compare?a={name}&b={other}")
    page.wait_for_timeout(3000)
    _picture(page, folder / "console-compare.png", 800)
    for day in range(1, 25):
        check(console.runs, day)
    page.goto(f"{console.url}/daily")
    page.wait_for_timeout(4000)
    _picture(page, folder / "console-daily.png", 1000)
    _fleet(console.runs)
    page.goto(f"{console.url}/fleet?type=KR5+R1400")
    page.wait_for_timeout(6000)
    _picture(page, folder / "console-fleet.png", 1100)
    _analysis(page, console, folder)


def _fleet(runs: Path) -> None:
    """Monthly runs of six robots in 2026, one with a joint zero that moved, one with a link that grows."""
    rng = np.random.default_rng(1)
    for robot in range(6):
        for month in range(1, 12):
            moved = {"theta3": 9e-4 * (robot == 1 and month > 7), "a2": 0.05 * month * (robot == 4)}
            errors = {each: moved.get(each, 0.0) + rng.normal(0.0, NOISE[each[0]]) for each in DRIFTING}
            place = run_in(runs, f"sphere-{robot}-{month:02d}", f"2026-{month:02d}-0{1 + robot}", f"SIM-92518{robot}")
            kr5_model(errors=errors).save(place / "model.json")


def _started(page: Any, console: ConsoleProcess, folder: Path) -> str:
    """Start the campaign from the page; the run's name."""
    page.goto(f"{console.url}/start?procedure=sphere_selfcal&cell=sphere_cell")
    page.get_by_role("button", name="Check", exact=True).click()
    page.wait_for_timeout(6000)
    _picture(page, folder / "console-start.png", 860)
    page.get_by_role("button", name="Start the run").click()
    page.wait_for_url("**/run/sphere_selfcal-*", timeout=60_000)
    return str(page.url).rpartition("/")[2]


def _analysis(page: Any, console: ConsoleProcess, folder: Path) -> None:
    """Fit 300 rows of the real UR10 on the page."""
    data = console.runs.parent / "ur10.csv"
    if not UR10.exists():
        print("no picture of an analysis: the UR10 measurements are missing")
        return
    public_data = ROOT / "docs" / "examples" / "public_data.py"
    subprocess.run([sys.executable, public_data, UR10, "300", "-o", data], check=True)
    page.goto(f"{console.url}/analyse")
    page.locator("input[type=file]").set_input_files(data)
    page.wait_for_url("**/analyse/ur10-*")
    page.get_by_role("button", name="Fit", exact=True).click()
    page.get_by_text("Better than nominal. Error of held-out positions").first.wait_for(timeout=300_000)
    _picture(page, folder / "console-analyse.png", 1000)


def _picture(page: Any, file: Path, height: int) -> None:
    page.set_viewport_size({"width": _WIDTH, "height": height})
    page.wait_for_timeout(2500)
    page.screenshot(path=file)
    Image.open(file).convert("RGB").quantize(256, dither=Image.Dither.NONE).save(file, optimize=True)
