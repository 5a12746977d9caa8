"""The tool's procedures over the wires of the simulated sphere cell."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from cellctl.formats import RobotFile
from cellctl.journal import fold, read_journal
from cellctl.metrology.four_point import tips
from cellctl.operations.replay import Agreement, replay_run
from procedures.steps.tool.rows import ToolTouchRow, ToolVerdict
from tests.helpers.runs import ROOT, cellctl, quick_cell
from tests.helpers.simulated_data import true_points

pytestmark = pytest.mark.campaign

ONLY_THE_TOOL = "  errors: {geometry: 0, joint_zero: 0, deflection: 0}\n"
FEW = ["--set", "orientations=5", "--set", "orientations_test=2", "--set", "touches=3"]


@pytest.mark.long
def test_on_a_robot_with_a_wrong_tool_alone_the_true_tool_is_found_and_replay_finds_it_again(tmp_path: Path) -> None:
    cell, result = quick_cell(tmp_path, ONLY_THE_TOOL), tmp_path / "result.json"
    done = cellctl("run", "tool_four_point", "--cell", cell, *FEW, "--runs", tmp_path / "runs", "--json", result)
    assert done.returncode == 0, done.stderr
    content = json.loads(result.read_text())
    run = tmp_path / "runs" / content["run"]
    state = fold(read_journal(run))
    verdict, rows = state.last(ToolVerdict), state.recorded(ToolTouchRow)
    assert verdict is not None
    assert (content["verdict"], content["points"], content["tool"]["contacts"]) == ("better", 21, 15)
    robot = RobotFile.load(ROOT / "procedures" / "robots" / "kr5_r1400.yaml")
    readings = np.array([row.joints for row in rows])
    flanges = robot.chain().forward_flange(robot.joint_map().model(readings))
    off = tips(flanges, np.array(verdict.tool.found)) - true_points(cell, 1, readings, tmp_path)
    assert np.abs(off).max() < 4 * max(verdict.tool.sigma) < 0.3
    again = replay_run(run)
    assert again.agreement is Agreement.EXACT
    assert "tool.yaml" in {file.name for file in again.artefacts}


@pytest.mark.long
def test_a_robot_that_nobody_moves_between_the_confirmations_finds_no_tool(tmp_path: Path) -> None:
    done = cellctl("run", "tool_at_point", "--confirm-all", "--runs", tmp_path / "runs")
    assert done.returncode == 2
    assert "too much alike" in done.stderr
