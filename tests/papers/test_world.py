"""The World of the papers' studies is that of the simulated cell, with the noise of its instrument."""

from pathlib import Path

import numpy as np
import pytest

from tests.studies.papers.world import PaperWorld, plate_of, pose_of_plate, ways_of

CELL = Path(__file__).parents[2] / "procedures" / "cells" / "tracker_cell.yaml"
READINGS = np.array([0.0, -80.0, 90.0, 10.0, 60.0, 0.0]) + np.random.default_rng(1).uniform(-20, 20, (40, 6))


def test_a_switch_changes_what_it_names_and_nothing_else():
    usual, sagging = PaperWorld.of(CELL, 3), PaperWorld.of(CELL, 3, {"compliance": 1.0})
    assert 0.05 < np.linalg.norm(sagging.points(READINGS) - usual.points(READINGS), axis=1).mean() < 2.0
    np.testing.assert_array_equal(sagging.scatter(READINGS), usual.scatter(READINGS))


def test_an_unknown_switch_is_refused():
    with pytest.raises(AssertionError, match="compliant"):
        PaperWorld.of(CELL, 3, {"compliant": 1.0})


def test_the_play_acts_by_the_way_of_each_joint():
    played = PaperWorld.of(CELL, 3, {"backlash": 1.0})
    ways = ways_of(READINGS)
    assert np.linalg.norm(played.points(READINGS, ways) - played.points(READINGS, -ways), axis=1)[1:].min() > 1e-3


def test_a_joint_that_does_not_move_keeps_its_direction():
    assert ways_of(np.array([[0.0], [1.0], [1.0], [0.5]])).ravel().tolist() == [0, 1, 1, -1]


def test_measured_points_scatter_as_robot_and_instrument_do():
    world = PaperWorld.of(CELL, 3)
    true = world.reflectors(world.flanges(READINGS))[:, 0]
    errors = world.measured(READINGS, "a")[:, 0] - true
    # robot 0.03 mm (3-D RMS); station: along the beam 0.12/√3 mm, across it 0.05 mm for each of two axes
    assert np.sqrt(np.mean(np.sum(errors**2, axis=1))) == pytest.approx(np.hypot(0.03, np.hypot(0.07, 0.075)), rel=0.2)


def test_the_pose_of_a_plate_is_that_of_its_reflectors():
    world = PaperWorld.of(CELL, 3)
    seen = world.reflectors(world.flanges(READINGS))
    plate = plate_of(seen)
    poses = np.array([pose_of_plate(plate, one) for one in seen])
    np.testing.assert_allclose(poses[:, :3, :3] @ plate.T + poses[:, :3, 3:], np.swapaxes(seen, 1, 2), atol=1e-6)
    relative = np.linalg.inv(world.flanges(READINGS)) @ poses
    np.testing.assert_allclose(relative, np.broadcast_to(relative[0], relative.shape), atol=1e-6)
