"""What the studies of positions build on: the least squares of the papers, the noise of the cells, small studies."""

from __future__ import annotations

import numpy as np
import pytest

from tests.studies.papers import kriging, point_selection
from tests.studies.papers.kriging import UNLOADED, WORKSPACE, drawn
from tests.studies.papers.positions import Arm, least_squares
from tests.studies.papers.world import PaperWorld

ARM = kriging.ARM
TRUE = ARM.chain.with_parameters({"theta2": 0.002, "a2": 0.8, "alpha1": 0.001, "beta2": 0.002, "tool_x": 0.4})


@pytest.fixture(scope="module")
def readings() -> np.ndarray:
    return drawn(WORKSPACE, "quasi-random", 120, 0, 1)


@pytest.mark.parametrize(("kind", "exact"), [("poe", True), ("mdh", True), ("dh", False)])
def test_all_descriptions_but_dh_without_beta_hold_every_error_of_the_links(readings, kind, exact):
    q = ARM.joints.model(readings)
    places = TRUE.forward(q)[:, :3, 3]
    found = least_squares(ARM.table(convention=kind), q[:80], places[:80])
    left = np.linalg.norm(found.forward(q[80:])[:, :3, 3] - places[80:], axis=1)
    assert (left.max() < 1e-4) == exact


def test_robot_and_tracker_of_the_heavy_cell_are_003_mm_together(readings):
    world = PaperWorld.of(kriging.CELL, 1)
    errors = world.measured_points(readings, "a") - world.reflectors(world.flanges(readings))[:, 0]
    assert np.sqrt(np.mean(np.sum(errors**2, axis=1))) == pytest.approx(0.03, rel=0.1)


def test_the_load_sags_the_heavy_robot_by_millimetres(readings):
    loaded, bare = (PaperWorld.of(kriging.CELL, 1, payload=payload) for payload in (None, UNLOADED))
    sag = np.linalg.norm(loaded.flanges(readings[:20])[:, :3, 3] - bare.flanges(readings[:20])[:, :3, 3], axis=1)
    assert 0.5 < sag.mean() < 5.0


def test_friction_winds_up_the_joints_of_the_flexible_arm_against_their_last_motion():
    readings = point_selection.drawn(point_selection.WORKSPACE, "quasi-random", 8, 1)
    forth = np.ones(readings.shape, int)
    for switches, moved in (({}, True), ({"friction_torsion": 0.0}, False)):
        world = PaperWorld.of(point_selection.CELL, 1, switches)
        apart = world.flanges(readings, forth)[:, :3, 3] - world.flanges(readings, -forth)[:, :3, 3]
        assert (np.linalg.norm(apart, axis=1).min() > 0.1) == moved


def test_the_arm_of_a_cell_has_its_reflector_as_tcp():
    arm = Arm.of(point_selection.CELL)
    assert arm.chain.tool_now[:3, 3].tolist() == [-120.0, 0.0, 80.0]


@pytest.mark.long
def test_the_ordinary_fit_predicts_the_heavy_robot_as_well_as_its_noise_allows_and_better_than_kriging():
    found = kriging.in_world(1, baselines=False)
    assert found["ours_mean"] <= 0.045
    assert found["ours_max"] <= 0.11
    assert found["ours_ratio"] <= 1.15
    assert found["ours_rms"] < found["filtered_rms"] < 0.1 * found["nominal_rms"]


@pytest.mark.long
def test_the_ordinary_fit_predicts_the_flexible_arm_on_its_path_as_well_as_its_noise_allows():
    bench = point_selection.Bench.of(1, {}, unloaded=False)
    readings = point_selection.drawn(point_selection.WORKSPACE, "quasi-random", 2000, 1)
    found = point_selection.ours(bench, readings, alone=False)
    assert found["ours_mean"] <= 0.20
    assert found["ours_ratio"] <= 1.3
    assert found["motor_mean"] <= 0.20
