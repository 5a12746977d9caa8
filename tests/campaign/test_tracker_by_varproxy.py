"""A tracker campaign on a controller without licences: moves, table and proof through the variable proxy."""

import json

import pytest

from tests.helpers.runs import cellctl
from tests.helpers.tracker import FEW, PROCEDURE, cell_of

pytestmark = [pytest.mark.campaign, pytest.mark.long]


def test_the_table_is_pushed_proved_and_left_in_force(tmp_path):
    cell = cell_of(tmp_path)
    lines = cell.read_text().splitlines()
    place = next(n for n, line in enumerate(lines) if "kuka+rsi" in line)
    lines[place] = "  robot: kuka+varproxy://172.31.1.147:7000"
    limits = next(n for n, line in enumerate(lines) if "correction_deg" in line)
    lines[limits] = "  robot: {speed_percent: 100}"
    cell.write_text("\n".join(lines))
    values = [word for name, value in FEW.items() for word in ("--set", f"{name}={value}")]
    places = ("--cell", cell, "--runs", tmp_path, "--json", tmp_path / "result.json")
    ended = cellctl("run", PROCEDURE, *values, *places, "--confirm-all")
    assert ended.returncode == 0, ended.stderr
    result = json.loads((tmp_path / "result.json").read_text())
    assert result["verdict"] == "better"
    assert result["table"]
