"""The campaigns of the KUKA cells on a UR10e: the same procedures, with another cell."""

import json

import pytest

from tests.helpers.runs import ROOT, cellctl
from tests.helpers.tracker import FEW

pytestmark = [pytest.mark.campaign, pytest.mark.long]

CELL = ROOT / "procedures" / "cells" / "ur10e_cell.yaml"
TOUCHES = {
    "touches_fit": 30,
    "touches_test": 6,
    "touches_locate": 4,
    "standoff_targets": 6,
    "reference_every": 0,
    "search_speed": 10,
    "transfer_speed": 50,
}
POSES = FEW | {"poses_fit": 20, "poses_test": 6, "from_both": 0, "monuments_every": 40, "transfer_speed": 50}


def cell_of(folder, series):
    """The shipped cell with a controller that has cycles of 2 ms (e) or 8 ms (cb3)."""
    text = CELL.read_text().replace("../robots/", f"{ROOT}/procedures/robots/")
    text = text.replace("programs: ur10e_programs", f"series: {series}, programs: {CELL.parent}/ur10e_programs")
    cell = folder / "cell.yaml"
    cell.write_text(text)
    return cell


@pytest.mark.parametrize(
    ("procedure", "series", "values"),
    [("sphere_selfcal", "e", TOUCHES), ("tracker_calibration", "cb3", POSES)],
)
def test_it_is_identified_and_the_table_that_this_computer_holds_is_proved(tmp_path, procedure, series, values):
    settings = [word for name, value in values.items() for word in ("--set", f"{name}={value}")]
    places = ("--cell", cell_of(tmp_path, series), "--runs", tmp_path / "runs", "--json", tmp_path / "result.json")
    ended = cellctl("run", procedure, *settings, *places, "--confirm-all")
    assert ended.returncode == 0, ended.stderr
    result = json.loads((tmp_path / "result.json").read_text())
    assert result["verdict"] == "better"
    (kept,) = (tmp_path / "runs").glob("*/drivers/*.json")
    assert json.loads(kept.read_text())["content"]["active"]["id"] == result["table"]["id"]


def test_a_daily_check_begins_its_baseline(tmp_path):
    places = ("--cell", CELL, "--runs", tmp_path / "runs", "--json", tmp_path / "result.json")
    ended = cellctl("run", "daily_check", "--set", "samples=2", "--set", "transfer_speed=50", *places)
    assert ended.returncode == 0, ended.stderr
    assert "Baseline 'first', run 1 of 20" in json.loads((tmp_path / "result.json").read_text())["sentence"]
