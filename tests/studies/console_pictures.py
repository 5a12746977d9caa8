"""Pictures of each view of the console for the documents: `python tests/studies/console_pictures.py [FOLDER]`.

Starts a console with the simulated sphere cell, runs a campaign from the page, and writes PNG files to the folder
(default: docs/images). Needs Debian's Chromium.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from typing import Any

from PIL import Image

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "tests" / "helpers"))

from console_process import ConsoleProcess, browser, console_process  # noqa: E402

_WIDTH = 1280


def main(folder: Path) -> None:
    """Write the pictures of the views to `folder`."""
    with tempfile.TemporaryDirectory() as place, browser() as chromium:
        runs = Path(place) / "runs"
        with console_process(runs, "--cell", "sphere_cell") as console:
            page = chromium.new_page(viewport={"width": _WIDTH, "height": 860})
            page.goto(console.command_url)
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
    _analysis(page, console, folder)


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
    page.goto(f"{console.url}/analyse")
    page.wait_for_timeout(2000)
    _picture(page, folder / "console-analyse.png", 700)


def _picture(page: Any, file: Path, height: int) -> None:
    page.set_viewport_size({"width": _WIDTH, "height": height})
    page.wait_for_timeout(2500)
    page.screenshot(path=file)
    Image.open(file).convert("RGB").quantize(128).save(file, optimize=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "docs" / "images")
