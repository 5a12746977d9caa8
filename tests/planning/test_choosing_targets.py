"""Choice among dense samples: every part of every joint; nearest to a path, as many different ones as asked for."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

from cellctl.planning._target_sets import along, joint_uniform, near_path, partition_of

UR10 = Path(__file__).parents[3] / "shared" / "data" / "ur10_tracker" / "measurements_grid.csv"
RNG = np.random.default_rng(7)
DENSE = np.column_stack([RNG.normal(0, 20, 3000), RNG.exponential(10, 3000), RNG.uniform(-5, 5, 3000)])
BOX = RNG.uniform([0, 0, 0], [1000, 800, 300], (2000, 3))
U_PATH = np.array([[100.0, 100, 150], [900, 100, 150], [900, 700, 150], [100, 700, 150]])


def parts(values, like, count):
    low, high = like.min(axis=0), like.max(axis=0)
    return [
        set(np.clip((count * (values[:, j] - low[j]) / (high[j] - low[j])).astype(int), 0, count - 1)) for j in range(3)
    ]


def test_every_part_of_every_joint_that_has_a_sample_is_covered():
    chosen = joint_uniform(DENSE, 60, 20, np.random.default_rng(1))
    assert len(set(chosen.tolist())) == 60
    assert parts(DENSE[chosen], DENSE, 20) == parts(DENSE, DENSE, 20)


def test_as_many_as_there_are_takes_all_and_more_are_refused():
    assert sorted(joint_uniform(DENSE[:50], 50, 10, np.random.default_rng(1)).tolist()) == list(range(50))
    with pytest.raises(ValueError, match="51 of 50"):
        joint_uniform(DENSE[:50], 51, 10, np.random.default_rng(1))


def test_a_joint_that_never_moves_is_no_obstacle():
    held = np.column_stack([DENSE, np.full(len(DENSE), 12.5)])
    assert len(set(joint_uniform(held, 40, 10, np.random.default_rng(1)).tolist())) == 40


def test_five_hundred_different_points_hold_the_union_of_the_ten_nearest_to_each_path_point():
    path = along(U_PATH, 50)
    chosen = set(near_path(BOX, path, 500).tolist())
    union = {int(i) for point in path for i in np.argsort(np.linalg.norm(BOX - point, axis=1))[:10]}
    assert len(chosen) == 500
    assert union < chosen
    assert 100 < len(union) < 300  # why the paper's 500 need a rule


def test_no_point_passed_over_is_nearer_to_every_path_point_than_a_chosen_one():
    path = along(U_PATH, 50)
    chosen = near_path(BOX, path, 200)
    rank = np.argsort(np.argsort(np.linalg.norm(path[:, None] - BOX, axis=2), axis=1), axis=1).min(axis=0)
    assert rank[chosen].max() <= np.delete(rank, chosen).min() + 1


def test_points_along_a_path_have_equal_distances_and_its_ends():
    path = along(U_PATH, 50)
    length = 800.0 + 600.0 + 800.0
    assert np.allclose(path[[0, -1]], U_PATH[[0, -1]])
    steps = np.linalg.norm(np.diff(path, axis=0), axis=1)
    assert np.median(steps) == pytest.approx(length / 49)
    assert steps.max() <= length / 49 + 1e-9


@pytest.mark.skipif(not UR10.exists(), reason=f"the UR10 measurements are not at {UR10}")
def test_of_rows_measured_on_a_real_ur10_joint_uniform_covers_every_part_of_every_joint_and_a_draw_does_not():
    with UR10.open(newline="") as source:
        rows = list(csv.DictReader(source, delimiter=";"))
    names = [f"{joint}_joint" for joint in ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")]
    readings = np.degrees([[float(row[name].replace(",", ".")) for name in names] for row in rows])
    part = partition_of(readings, 20)
    there = {(joint, number) for joint in range(6) for number in part[:, joint]}

    def covered(chosen):
        return {(joint, number) for joint in range(6) for number in part[chosen, joint]}

    rng = np.random.default_rng(1)
    assert covered(joint_uniform(readings, 160, 20, rng)) == there
    assert len(there - covered(rng.permutation(len(readings))[:160])) > 5
