"""Measuring poses of a tracker campaign: visible, above the floor, from stated sides, fit and judges apart."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cellctl.formats import RobotFile
from cellctl.kinematics import inverse
from cellctl.planning import Counts, OutOfReach, PoseOptions, Sight, plan_measuring_poses
from cellctl.planning.ways import Reach

ROBOT = RobotFile.load(Path(__file__).parents[2] / "procedures/robots/kr5_r1400.yaml")
CHAIN, JOINTS, LIMITS = ROBOT.chain(), ROBOT.joint_map(), ROBOT.limits()
REACH = Reach(*(tuple(column) for column in LIMITS.T.tolist()))
HOME = np.array([0.0, -90.0, 90.0, 0.0, 45.0, 0.0])
STATION = np.array([3200.0, -600.0, 900.0])
SIGHT = Sight(STATION, np.array([[90.0, 0.0, 120.0]]), np.array([[0.3, 0.0, 1.0]]))
SIDES = (1, -1, 1, 1, -1, 1)
OPTIONS = PoseOptions(side=SIDES, step=3.0, floor=-400.0)


def plan(seed=1, sight=SIGHT, counts=None, options=OPTIONS):
    return plan_measuring_poses(CHAIN, JOINTS, REACH, sight, counts or Counts(), HOME, seed, options)


PLAN = plan()


def flanges(readings):
    return CHAIN.forward_flange(JOINTS.model(readings))


def test_every_reflector_faces_the_station_in_range():
    for flange in flanges(PLAN.readings):
        place = flange[:3, :3] @ SIGHT.reflectors[0] + flange[:3, 3]
        facing = flange[:3, :3] @ SIGHT.facing[0] / np.linalg.norm(SIGHT.facing[0])
        beam = STATION - place
        angle = np.degrees(np.arccos(facing @ beam / np.linalg.norm(beam)))
        assert angle < SIGHT.acceptance
        assert SIGHT.nearest < np.linalg.norm(beam) < SIGHT.farthest


def test_no_beam_passes_through_forearm_or_upper_arm():
    """Sampled along beam and links, apart from the planner's own distance of lines."""
    share = np.linspace(0.0, 1.0, 200)[:, None]
    for readings in PLAN.readings:
        flange, q = flanges(readings), JOINTS.model(readings)
        beam = flange[:3, :3] @ SIGHT.reflectors[0] + flange[:3, 3]
        beam = beam + share * (STATION - beam)
        joints = CHAIN.frames(q)[:, :3, 3]
        upper, fore = joints[1] + share * (joints[2] - joints[1]), joints[3] + share * (joints[4] - joints[3])
        assert np.linalg.norm(beam[:, None] - upper, axis=2).min() > 120.0
        assert np.linalg.norm(beam[:, None] - fore, axis=2).min() > 50.0


def test_the_robot_stays_above_the_floor_at_postures_approaches_and_on_the_ways_between():
    here = HOME
    for readings, approach, over_home in zip(PLAN.readings, PLAN.approach, PLAN.over_home, strict=True):
        stops = [here, *([HOME] if over_home else []), approach, readings]
        for start, end in pairwise(stops):
            way = JOINTS.model(np.linspace(start, end, 60))
            tcp, links = CHAIN.forward(way)[:, 2, 3], CHAIN.frames(way)[:, 2:, 2, 3]
            assert min(tcp.min(), links.min()) > OPTIONS.floor + OPTIONS.clearance - 5.0
        here = readings


def test_limits_keep_their_margin_also_where_approaches_from_both_sides_begin():
    for readings in (PLAN.readings, PLAN.approach, 2.0 * PLAN.readings - PLAN.approach):
        assert (readings >= LIMITS[:, 0] + REACH.margin - 1e-3).all()
        assert (readings <= LIMITS[:, 1] - REACH.margin + 1e-3).all()


def test_each_posture_is_approached_from_the_stated_side_and_a_share_of_the_fit_from_both():
    assert np.allclose(PLAN.readings - PLAN.approach, OPTIONS.step * PLAN.side)
    stated = (PLAN.side == SIDES).all(axis=1)
    other = (PLAN.side == -np.array(SIDES)).all(axis=1)
    assert (stated | other).all()
    assert np.count_nonzero(other) == 12
    assert not PLAN.held_out[other].any()
    for place in np.flatnonzero(other):
        partner = PLAN.again[place]
        assert stated[partner]
        assert PLAN.again[partner] == place
        assert np.array_equal(PLAN.readings[partner], PLAN.readings[place])


def test_held_out_postures_are_interleaved_and_in_one_late_block_and_never_in_the_fit():
    assert np.count_nonzero(PLAN.held_out) == 50
    assert PLAN.late[-25:].all()
    assert np.count_nonzero(PLAN.late) == 25
    interleaved = np.flatnonzero(PLAN.held_out & ~PLAN.late)
    assert interleaved.min() < 20
    assert interleaved.max() > len(PLAN) - 25 - 20
    fit = {tuple(q) for q in PLAN.readings[~PLAN.held_out]}
    assert fit.isdisjoint({tuple(q) for q in PLAN.readings[PLAN.held_out]})


def test_the_order_is_random_not_that_of_the_sequence():
    rank = np.argsort(np.argsort(PLAN.readings[:-25, 0]))
    assert abs(np.corrcoef(rank[:-1], rank[1:])[0, 1]) < 0.3


def test_the_same_seed_gives_the_same_plan_and_another_seed_another():
    assert np.array_equal(PLAN.readings, plan().readings)
    assert not np.array_equal(PLAN.readings, plan(seed=2).readings)


def test_all_nests_of_a_plate_are_visible_at_every_posture():
    corners = np.array([[90.0, 0.0, 120.0], [-60.0, 80.0, 120.0], [-60.0, -80.0, 120.0]])
    poses = plan(sight=Sight(STATION, corners, np.tile([0.0, 0.0, 1.0], (3, 1))), counts=Counts(20, 10, 5))
    flange = flanges(poses.readings)
    for corner in corners:
        beam = STATION - (flange[:, :3, :3] @ corner + flange[:, :3, 3])
        cosine = np.einsum("ki,ki->k", beam, flange[:, :3, 2]) / np.linalg.norm(beam, axis=1)
        assert np.degrees(np.arccos(cosine)).max() < 27.0


def test_what_cannot_be_seen_is_refused_with_the_reason():
    with pytest.raises(OutOfReach, match="no reflector faces the station in range"):
        plan(sight=replace(SIGHT, nearest=39_000.0))


def test_sides_are_needed_for_every_joint():
    with pytest.raises(ValueError, match="each of 6 joints"):
        plan(options=PoseOptions(side=(1, 1)))


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_held_out_postures_are_within_the_joints_of_the_fit(seed):
    found = plan(seed)
    fit, held_out = found.readings[~found.held_out], found.readings[found.held_out]
    assert (held_out >= fit.min(axis=0)).all()
    assert (held_out <= fit.max(axis=0)).all()


def test_no_posture_needs_a_large_correction_for_a_small_error_of_orientation():
    """By inverse kinematics: no posture is near a singularity."""
    poses, q = CHAIN.forward(JOINTS.model(PLAN.readings)), JOINTS.model(PLAN.readings)
    error = np.radians(0.3)
    for axis in np.eye(3):
        turned = poses.copy()
        turned[:, :3, :3] = Rotation.from_rotvec(error * axis).as_matrix() @ poses[:, :3, :3]
        found = inverse(CHAIN, turned, q)
        assert found.converged.all()
        assert np.abs(found.q - q).max() < 1.05 * PoseOptions().amplified * error


def test_no_reflector_of_a_wide_plate_is_inside_the_forearm():
    """Sampled along the forearm; 60 mm is its radius."""
    places = np.array([[120.0, 0.0, 80.0], [120.0, 130.0, 0.0], [120.0, -130.0, 0.0]])
    sight = Sight(np.array([3400.0, -1200.0, 900.0]), places, np.tile([1.0, 0.0, 0.0], (3, 1)))
    share = np.linspace(0.0, 1.0, 200)[:, None]
    readings = plan(sight=sight, counts=Counts(150, 0, 0)).readings
    for flange, frames in zip(flanges(readings), CHAIN.frames(JOINTS.model(readings)), strict=True):
        fore = frames[3, :3, 3] + share * (frames[4, :3, 3] - frames[3, :3, 3])
        seen = places @ flange[:3, :3].T + flange[:3, 3]
        assert np.linalg.norm(seen[:, None] - fore, axis=2).min() > 60.0
