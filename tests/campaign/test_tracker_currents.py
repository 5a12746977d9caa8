"""A tracker campaign whose motor currents come from the controller over RSI, and a fit with them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cellctl.calibration import Split, fit
from cellctl.engine import State
from cellctl.formats import DataSet, RobotFile
from cellctl.formats.measurements import measurements
from procedures.steps.tracker.rows import PoseRow
from tests.helpers.runs import ROOT, Ended, run_here
from tests.helpers.tracker import Truth, cell_of, procedure_of

pytestmark = [pytest.mark.campaign, pytest.mark.long]

ERRORS = "  errors: {compliance: 4, friction_torsion: 1}\n"
ROBOT = ROOT / "procedures" / "robots" / "kr5_r1400.yaml"
NOISE_A = 0.02
"""1 σ of a telegram's current (docs/simulated-cell.md)."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("currents")


@pytest.fixture(scope="module")
def ended(folder: Path) -> Ended:
    cell = cell_of(folder, ERRORS)
    text = cell.read_text()
    assert "currents: {source: drives}" in text
    cell.write_text(text.replace("currents: {source: drives}", "currents: {source: robot}"))
    return run_here(procedure_of(folder, poses_fit=40), cell, folder)


def test_every_pose_has_the_currents_of_the_controller(ended: Ended, folder: Path) -> None:
    assert ended.outcome.state is State.FINISHED, ended.outcome.error
    world, rows = Truth(folder / "cell.yaml", 1)._world, ended.journal.recorded(PoseRow)
    assert len(rows) >= 48
    for row in rows:
        assert row.currents is not None
        friction = world.motors.friction(row.direction, (0.0,) * 6)
        true = np.add(world.holding_currents(row.joints), friction)
        assert np.abs(np.subtract(row.currents.amperes, true)).max() < 5.0 * NOISE_A


def test_a_fit_with_these_currents_predicts_held_out_poses_better_than_geometry_alone(
    ended: Ended, folder: Path
) -> None:
    assert ended.outcome.state is State.FINISHED, ended.outcome.error
    data, robot = DataSet.load(folder / "run" / "dataset.csv"), RobotFile.load(ROBOT)

    def held_out_rms(model: str) -> float:
        measured = measurements(robot, data, model=model)
        return fit(measured.task, Split.by_column(np.array(measured.sets) == "test")).test.rms

    assert held_out_rms("geometry+motor") < 0.5 * held_out_rms("geometry")
