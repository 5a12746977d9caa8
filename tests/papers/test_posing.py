"""Poses of the studies are those that a campaign on the cell plans and measures."""

import numpy as np
import pytest

from cellctl.calibration import Split, fit
from tests.studies.papers.compensation_methods import CELL
from tests.studies.papers.posing import PoseCell, Poses, comprehensive
from tests.studies.papers.world import PaperWorld


@pytest.fixture(scope="module")
def cell():
    return PoseCell.load(CELL)


@pytest.fixture(scope="module")
def planned(cell):
    return cell.planned(20, 10, 1)


def test_poses_are_as_many_as_the_procedure_asks_for(planned):
    assert np.count_nonzero(~planned.held_out) == 20
    assert np.count_nonzero(planned.held_out) == 10
    assert set(np.unique(planned.ways)) == {1}


def test_the_identified_robot_leaves_the_noise_of_robot_and_instrument(cell, planned):
    poses = Poses.of(cell, PaperWorld.of(CELL, 1), planned)
    result = fit(poses.task(), Split.by_column(planned.held_out))
    before, after = result.nominal.rms, result.test.rms
    assert before > 0.2
    # robot 0.03 mm, instrument 0.018 mm (3-D RMS): 0.035 mm; 30 numbers show 0.6 to 1.4 times that (99.9 %), and up to
    # 1.3 times more because 30 observable parameters come from 120 numbers
    assert 0.021 < after < 0.064


def test_a_load_at_the_held_out_poses_changes_only_these(cell, planned):
    usual = Poses.of(cell, PaperWorld.of(CELL, 1, {"expansion": 1.0}), planned)
    warm = Poses.of(
        cell, PaperWorld.of(CELL, 1, {"expansion": 1.0}), planned, PaperWorld.of(CELL, 1, {"expansion": 1.0}), 40.0
    )
    moved = np.linalg.norm(warm.poses[:, :3, 3] - usual.poses[:, :3, 3], axis=1)
    np.testing.assert_array_equal(moved[~planned.held_out], 0.0)
    assert moved[planned.held_out].min() > 0.05


def test_the_comprehensive_error_is_the_root_of_the_squared_means_of_the_axes():
    deviations = np.array([[3.0, 4.0, 0.0, 0.0, 0.0, 2.0], [-3.0, -4.0, 0.0, 0.0, 0.0, -4.0]])
    assert comprehensive(deviations) == pytest.approx((5.0, 3.0))
