"""`cellctl convert CELL`: the arm as its controller computes it, asked from the simulated UR; and a KUKA has none."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from cellctl.formats import RobotFile
from sims.cell import read_cell
from sims.ur._kinematics import Model, calibrated_rows
from tests.helpers.arms import cellctl

CELLS = Path(__file__).parents[2] / "procedures" / "cells"


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_the_controllers_own_arm_is_read_to_a_nanometre(capsys):
    cell = read_cell(CELLS / "ur10e_cell.yaml")
    assert cellctl("convert", cell.path, "--to", "mdh-hayati", "-o", "arm.yaml") == 0
    assert "maker's calibration of one arm" in capsys.readouterr().err
    robot = RobotFile.load(Path("arm.yaml"))
    assert robot.calibration is not None
    assert re.fullmatch(r"controller \S+", robot.calibration.file)
    assert robot.tool.xyz == list(cell.robot.tool.xyz)
    knows = cell.simulate.settings["ur"].get("calibration_knows", 0.7)
    own = Model(calibrated_rows(cell.robot, cell.simulate.seed, cell.simulate.errors, knows))
    sheet, chain = RobotFile.load(cell.path.parent / "../robots/ur10e_probe.yaml").chain(), robot.chain()
    behind = np.linalg.inv(chain.tool)
    differences = []
    for readings in np.random.default_rng(6).uniform(-180.0, 180.0, (50, 6)):
        q = np.radians(readings)
        found, wanted = chain.forward(q) @ behind, own.flange(tuple(q))
        assert np.linalg.norm(found[:3, 3] - 1000.0 * wanted[:3, 3]) < 1e-6
        differences.append(np.linalg.norm((sheet.forward(q) - chain.forward(q))[:3, 3]))
    assert max(differences) > 0.1


def test_a_robot_whose_controller_states_no_calibration_is_refused(capsys):
    assert cellctl("convert", CELLS / "sphere_cell.yaml", "--to", "poe") == 2
    assert "states no calibration of the arm" in " ".join(capsys.readouterr().err.split())
