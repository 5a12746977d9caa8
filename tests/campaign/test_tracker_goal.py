"""A tracker campaign with a goal over the wires: it stops there, the robot is as good, and it replays equal."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cellctl.engine import State
from cellctl.formats import ModelFile
from cellctl.records import BatchRow
from procedures.steps.tracker.rows import PoseRow
from tests.helpers.runs import Ended, cellctl
from tests.helpers.simulated_data import best_rigid
from tests.helpers.tracker import CELL, Truth, run, verdict_of

pytestmark = [pytest.mark.campaign, pytest.mark.long]

GOAL_MM = 0.1


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("goal")


@pytest.fixture(scope="module")
def ended(folder: Path) -> Ended:
    return run(folder, goal=GOAL_MM, poses_first=20, poses_batch=6, poses_test=10, poses_most=32)


def test_it_stops_at_its_goal_and_the_table_is_proved(ended: Ended) -> None:
    assert ended.outcome.state is State.FINISHED, ended.outcome.error
    curve, poses = ended.journal.recorded(BatchRow), ended.journal.recorded(PoseRow)
    assert [row.ended for row in curve] == [*[""] * (len(curve) - 1), "goal"]
    assert len(curve) > 1
    assert curve[-1].rows == len({row.commanded for row in poses if row.set == "fit"})
    assert [row.set for row in poses][-5:] == ["test"] * 5
    assert [row.set for row in poses].count("test") == 10
    found = verdict_of(ended)
    assert found.verdict == "better"


def test_the_robot_meets_it_in_truth(ended: Ended, folder: Path) -> None:
    """By the instrument: its scale is in no prediction."""
    poses = [row for row in ended.journal.recorded(PoseRow) if row.set == "test"]
    true = Truth(CELL, 1).places(poses, shown=True)
    model = ModelFile.load(folder / "run" / "model.json")
    predicted = np.array(model.predict(np.array([row.joints for row in poses])).poses)[:, :3, 3]
    errors = best_rigid(predicted, true).apply(predicted) - true
    assert np.sqrt(np.mean(np.sum(errors**2, axis=1))) < GOAL_MM


def test_its_replay_decides_the_same(ended: Ended, folder: Path) -> None:
    done = cellctl("replay", folder / "run")
    assert done.returncode == 0, done.stdout + done.stderr
    assert "next" in done.stdout
