"""The campaigns of the KUKA cells on a UR10e: the same procedures, with another cell."""

import json

import pytest

from tests.helpers.runs import cellctl
from tests.helpers.tracker import FEW

pytestmark = [pytest.mark.campaign, pytest.mark.long]

TOUCHES = {"touches_fit": 50, "touches_test": 10, "touches_locate": 4, "standoff_targets": 10}


@pytest.mark.parametrize(("procedure", "values"), [("sphere_selfcal", TOUCHES), ("tracker_calibration", FEW)])
def test_it_is_identified_and_the_table_that_this_computer_holds_is_proved(tmp_path, procedure, values):
    settings = [word for name, value in values.items() for word in ("--set", f"{name}={value}")]
    places = ("--cell", "ur10e_cell", "--runs", tmp_path, "--json", tmp_path / "result.json")
    ended = cellctl("run", procedure, *settings, *places, "--confirm-all")
    assert ended.returncode == 0, ended.stderr
    result = json.loads((tmp_path / "result.json").read_text())
    assert result["verdict"] == "better"
    (kept,) = tmp_path.glob("*/drivers/*.json")
    assert json.loads(kept.read_text())["content"]["active"]["id"] == result["table"]["id"]
