"""Targets for any instrument: in the region, within limits, in one configuration, visible, the same for a seed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import kstest, qmc

from cellctl.formats import RobotFile
from cellctl.planning import METHODS, JointRanges, OutOfReach, Reach, Sight, TargetOptions, TaskWorkspace, plan_targets

ROBOT = RobotFile.load(Path(__file__).parents[2] / "procedures/robots/kr5_r1400.yaml")
CHAIN, JOINTS, LIMITS = ROBOT.chain(), ROBOT.joint_map(), ROBOT.limits()
REACH = Reach(*(tuple(column) for column in LIMITS.T.tolist()))
BOX = np.array([[850.0, 1250.0], [-300.0, 300.0], [200.0, 600.0]])
CONSTANT = TaskWorkspace.of([*BOX, (0, 0), (180, 180), (0, 0)])
TILTED = TaskWorkspace.of([*BOX, (-30, 30), (150, 180), (-10, 20)])
PATH = np.array([[900.0, -200.0, 300.0], [1200.0, -200.0, 300.0], [1200.0, 200.0, 300.0], [900.0, 200.0, 300.0]])
STATION = np.array([3200.0, -600.0, 900.0])
SIGHT = Sight(STATION, np.array([[90.0, 0.0, 120.0]]), np.array([[0.3, 0.0, 1.0]]))
WIDE = JointRanges(np.array([-60.0, -120, 60, -100, -90, -180]), np.array([60.0, -45, 140, 100, 90, 180]))


NEAR = np.array([0.0, -60.0, 60.0, 0.0, 80.0, 30.0])


def plan(region=CONSTANT, method="quasi-random", count=60, held_out=0, seed=1, near=NEAR, **options):
    settings = TargetOptions(near, path=PATH, **options)
    settings = replace(settings, choose=lambda found, wanted: np.arange(len(found))[-wanted:])
    return plan_targets(CHAIN, JOINTS, REACH, region, method, count, held_out, seed, settings)


@pytest.mark.parametrize("method", METHODS)
def test_every_method_gives_the_targets_asked_for_in_the_box_within_the_limits(method):
    found = plan(method=method, held_out=20, dense=200)
    assert (len(found), int(found.held_out.sum())) == (80, 20)
    assert len(np.unique(found.readings, axis=0)) == 80
    place = found.poses[:, :3, 3]
    assert (place > BOX[:, 0] - 0.01).all()
    assert (place < BOX[:, 1] + 0.01).all()
    assert (found.readings >= LIMITS[:, 0] + REACH.margin - 1e-4).all()
    assert (found.readings <= LIMITS[:, 1] - REACH.margin + 1e-4).all()
    assert np.allclose(CHAIN.forward(JOINTS.model(found.readings)), found.poses)


@pytest.mark.parametrize("method", METHODS)
def test_the_same_seed_gives_the_same_targets_and_another_one_others(method):
    first, again, other = (
        plan(method=method, count=20, held_out=5, seed=seed, dense=120).readings for seed in (3, 3, 4)
    )
    assert first.tobytes() == again.tobytes()
    assert not np.allclose(first, other)


def test_a_constant_orientation_is_the_same_in_all_targets():
    wanted = Rotation.from_euler("ZYX", [0.0, 180.0, 0.0], degrees=True)
    turns = Rotation.from_matrix(plan().poses[:, :3, :3]) * wanted.inv()
    assert turns.magnitude().max() < 1e-5


def test_euler_ranges_hold_for_every_target():
    angles = Rotation.from_matrix(plan(TILTED).poses[:, :3, :3]).as_euler("ZYX", degrees=True)
    turned = angles[:, 1] < 150.0  # SciPy gives B within ±90: the same rotation is A + 180, 180 − B, C + 180
    angles[turned] = [180.0, 180.0, 180.0] + [1, -1, 1] * angles[turned]
    angles = (angles + 180.0) % 360.0 - 180.0
    angles[angles < -179.999] += 360.0
    assert (angles > TILTED.low[3:] - 1e-3).all()
    assert (angles < TILTED.high[3:] + 1e-3).all()


def test_rotations_do_not_gather_at_the_euler_singularity():
    """In KRG's ranges (B 75…105°) the z component of the tool's x axis, −sin B, is uniform: areas on a sphere are."""
    krg = TaskWorkspace.of([(1600, 2400), (-400, 800), (-400, 400), (85, 95), (75, 105), (60, 120)])
    poses = krg.poses(np.random.default_rng(1).random((4000, 6)))
    height = -poses[:, 2, 0]
    assert kstest((height - np.sin(np.radians(75))) / (1 - np.sin(np.radians(75))), "uniform").pvalue > 0.01
    above = poses[:, 0, 0] * np.cos(np.pi / 2) + poses[:, 1, 0] * np.sin(np.pi / 2) > 0  # cos B > 0
    assert 0.45 < above.mean() < 0.55


def test_all_targets_have_one_configuration_near_the_posture_asked_for():
    default = plan(near=None).readings
    flipped = plan(near=np.array([0.0, -60.0, 60.0, 180.0, -80.0, -140.0])).readings
    assert (default[:, 4] > 0.0).all()
    assert (flipped[:, 4] < 0.0).all()
    assert (np.abs(flipped[:, 3]) > 90.0).all()


def test_quasi_random_positions_are_more_even_than_pseudo_random_and_these_more_than_clustered_ones():
    def uneven(method):
        region = TaskWorkspace.of([*reachable, (0, 0), (180, 180), (0, 0)])
        found = plan(region, method, count=128)
        assert found.usable == found.drawn
        return qmc.discrepancy((np.clip(found.poses[:, :3, 3], *reachable.T) - reachable[:, 0]) / np.ptp(reachable, 1))

    reachable = np.array([[900.0, 1100.0], [-200.0, 200.0], [300.0, 500.0]])
    found = {method: uneven(method) for method in ("quasi-random", "halton", "pseudo-random", "clustered")}
    assert max(found["quasi-random"], found["halton"]) < 0.5 * found["pseudo-random"]
    assert found["pseudo-random"] < 0.5 * found["clustered"]


def test_joint_uniform_targets_fill_the_joints_more_evenly_than_the_box_does():
    def unevenness(method):
        fit = plan(TILTED, method, count=160, dense=1000).readings
        dense = plan(TILTED, "pseudo-random", count=500, seed=9).readings
        low, high = dense.min(axis=0), dense.max(axis=0)
        return sum(np.histogram(fit[:, j], 20, (low[j], high[j]))[0].var() for j in range(6))

    assert unevenness("joint-uniform") < 0.6 * unevenness("quasi-random")
    assert plan(TILTED, "joint-uniform", count=160, dense=1000).filled.min() > 0.8


def test_near_path_targets_are_nearer_to_the_path_than_random_ones_and_so_are_its_held_out_ones():
    def away(found, which):
        at = np.linspace(PATH[:-1], PATH[1:], 200).reshape(-1, 3)
        return np.linalg.norm(found.poses[which][:, None, :3, 3] - at, axis=2).min(axis=1).mean()

    near, box = plan(method="near-path", held_out=30, dense=600), plan(method="pseudo-random", held_out=30)
    assert away(near, ~near.held_out) < 0.4 * away(box, ~box.held_out)
    assert away(near, near.held_out) < 0.4 * away(box, box.held_out)


def test_joint_ranges_are_an_alternative_to_a_box():
    low, high = np.array([-5.0, -95, 85, -5, 85, -5]), np.array([5.0, -85, 95, 5, 95, 5])
    readings = plan(JointRanges(low, high), count=50).readings
    assert ((readings >= low) & (readings <= high)).all()
    assert (np.ptp(readings, axis=0) > 8.0).all()


def test_with_a_station_every_reflector_faces_it():
    found = plan(WIDE, count=30, sight=SIGHT)
    facing = SIGHT.facing[0] / np.linalg.norm(SIGHT.facing[0])
    for flange in CHAIN.forward_flange(JOINTS.model(found.readings)):
        beam = STATION - (flange[:3, :3] @ SIGHT.reflectors[0] + flange[:3, 3])
        assert np.degrees(np.arccos(flange[:3, :3] @ facing @ beam / np.linalg.norm(beam))) < SIGHT.acceptance
    assert found.rejected["no reflector faces the station in range"] > 0


def test_with_a_floor_the_arm_keeps_clear_of_it():
    raised = np.array([0, 60, 0, 0, 0, 0])
    free, kept = (plan(JointRanges(WIDE.low + raised, WIDE.high + raised), floor=each) for each in (None, 0.0))
    height = [CHAIN.forward(JOINTS.model(found.readings))[:, 2, 3].min() for found in (free, kept)]
    assert height[0] < 0.0 < 99.9 < height[1]


def test_a_region_out_of_reach_is_refused_with_its_cure():
    with pytest.raises(OutOfReach, match=r"no pose of the workspace is reached .*: check its frame"):
        plan(TaskWorkspace.of([(3000, 3100), (0, 1), (0, 1), (0, 0), (180, 180), (0, 0)]), near=None)


def test_too_few_targets_are_refused_with_what_rejected_most():
    behind = Sight(np.array([0.0, 0.0, 60_000.0]), SIGHT.reflectors, SIGHT.facing)
    with pytest.raises(OutOfReach, match=r"only 0 of 60 .* because no reflector faces the station in range \(\d+\)"):
        plan(WIDE, sight=behind)


@pytest.mark.parametrize(
    ("ranges", "words"),
    [
        ([*BOX[:2], (600, 200), (0, 0), (180, 180), (0, 0)], "range of Z is 600…200"),
        ([*BOX, (-200, 200), (0, 0), (0, 0)], "wider than 360"),
        ([*BOX, (0, 0), (0, 190), (0, 0)], "range of B"),
        ([*BOX[:2], (200, np.nan), (0, 0), (0, 0), (0, 0)], "range of Z"),
    ],
)
def test_wrong_ranges_are_named(ranges, words):
    with pytest.raises(ValueError, match=words):
        TaskWorkspace.of(ranges)
