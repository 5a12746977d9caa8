"""Poses from three reflectors of a plate: data set, figures, and a nest that is measured twice."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cellctl.engine import State
from cellctl.formats import DataSet
from procedures.steps.tracker.rows import PoseRow, SixRow, TrackerVerdict
from tests.helpers.steps import PROCEDURES, FakeRun, Faults, run_fake

PROCEDURE = PROCEDURES / "pose_calibration.yaml"
FEW: dict[str, Any] = {"poses_fit": 24, "poses_test": 8, "model": "geometry", "turn_points": 5}


@pytest.fixture(scope="module")
def ended(tmp_path_factory: pytest.TempPathFactory) -> FakeRun:
    return run_fake(PROCEDURE, tmp_path_factory.mktemp("poses"), FEW)


@pytest.mark.long
def test_the_identified_robot_is_better_in_position_and_in_attitude(ended: FakeRun) -> None:
    assert ended.outcome.state is State.FINISHED, ended.outcome.error
    verdict, six = ended.journal.last(TrackerVerdict), ended.journal.last(SixRow)
    assert verdict is not None
    assert six is not None
    assert verdict.verdict == "better"
    assert six.test.n == 8
    for figures in (six.fit, six.test):
        assert np.linalg.norm(figures.after) < 0.2 * np.linalg.norm(figures.before)
        assert figures.angle_after < 0.7 * figures.angle_before


def test_rows_are_poses_with_their_full_covariance(ended: FakeRun) -> None:
    data = DataSet.load(ended.folder / "dataset.csv")
    assert data.has("QW", "QX", "QY", "QZ", "sRX", "cXY", "cXRX", "cRYRZ")
    sigma = [float(text) for text in data.texts("sRX")]
    assert 0.0 < max(sigma) < 0.1


def test_r_ii_falls_from_pivot_to_pivot(ended: FakeRun) -> None:
    six = ended.journal.last(SixRow)
    assert six is not None
    assert list(six.r) == sorted(six.r, reverse=True)
    assert len(six.r) == len(six.parameters) > 24


@pytest.mark.long
def test_a_nest_measured_twice_is_measured_again_and_for_good_ends_the_run(tmp_path: Path) -> None:
    once = run_fake(PROCEDURE, tmp_path / "once", FEW, faults=Faults(twice={42}))
    assert once.outcome.state is State.FINISHED, once.outcome.error
    assert max(row.attempt for row in once.journal.recorded(PoseRow)) == 2
    always = run_fake(PROCEDURE, tmp_path / "always", FEW, faults=Faults(twice=set(range(42, 999))))
    assert always.outcome.state is State.FAILED
    assert "one nest was measured twice" in str(always.outcome.error)
