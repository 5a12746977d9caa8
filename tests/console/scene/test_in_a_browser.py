"""Scene and charts in Chromium: what is drawn after changes is what a page that opens then draws."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.helpers.console import browser, free_port

pytestmark = pytest.mark.long

ROOT = Path(__file__).parents[3]

DRAWN = """() => {
  const scene = Object.entries(window).find(([name]) => name.startsWith("scene_"))[1];
  const marks = [];
  scene.traverse((thing) => { if (thing.isPoints) marks.push(thing.geometry.drawRange.count); });
  const charts = [...document.querySelectorAll(".nicegui-echart")].map((one) => getElement(one.id.slice(1)).chart);
  return { marks, series: charts[0].getOption().series.map((one) => [one.name, one.data.length]) };
}"""
"""Marks of each shape, and the points of each series of the first chart."""


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    port, folder = free_port(), tmp_path_factory.mktemp("page")
    inherited = {name: value for name, value in os.environ.items() if not name.startswith("PYTEST")}
    environment = {**inherited, "NICEGUI_STORAGE_PATH": str(folder), "PYTHONPATH": str(ROOT)}
    program = [sys.executable, "-m", "tests.helpers.scene_page", str(port)]
    process = subprocess.Popen(program, env=environment, cwd=folder)
    try:
        yield f"http://127.0.0.1:{port}/"
    finally:
        process.kill()
        process.wait()


def opened(chromium: Any, address: str) -> tuple[Any, list[str]]:
    """A page that has drawn everything, and what went wrong in it."""
    page, wrong = chromium.new_page(), []
    page.on("pageerror", lambda error: wrong.append(str(error)))
    page.on("console", lambda line: wrong.append(line.text) if line.type == "error" else None)
    page.goto(address)
    page.wait_for_function(f"() => {{ try {{ return ({DRAWN})().marks.length == 8 }} catch {{ return false }} }}")
    return page, wrong


def wait_for_address(chromium: Any, address: str) -> None:
    """Until the page is served: a process takes some seconds to start."""
    page = chromium.new_page()
    for _ in range(200):
        try:
            page.goto(address)
            break
        except Exception:  # refused as long as nothing listens
            page.wait_for_timeout(200)
    page.close()


def test_changes_lead_to_what_a_new_page_draws(address: str) -> None:
    with browser() as chromium:
        wait_for_address(chromium, address)
        page, wrong = opened(chromium, address)
        first = page.evaluate(DRAWN)
        assert sum(first["marks"]) == 30
        page.get_by_role("button", name="One more").click()
        page.get_by_text("21 touches").wait_for()
        page.wait_for_timeout(300)
        assert sum(count for _, count in page.evaluate(DRAWN)["series"]) == 21
        page.get_by_role("button", name="All", exact=True).last.click()
        page.get_by_text("30 touches").wait_for()
        page.wait_for_timeout(300)
        drawn = page.evaluate(DRAWN)
        assert sorted(drawn["marks"]) == [0, 0, 0, 0, 0, 0, 7, 23]
        assert dict(drawn["series"]) == {
            "nominal robot, points of the fit": 23,
            "nominal robot, held-out points": 7,
            "identified robot, points of the fit": 23,
            "identified robot, held-out points": 7,
        }
        assert wrong == []
