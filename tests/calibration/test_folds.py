"""Which rows judge the others: every row once, repeats of a posture together, and the ends of what was measured."""

import numpy as np
import pytest

from cellctl.calibration.folds import FOLDS, end_folds, random_folds


@pytest.mark.parametrize("count", [1, 3, 200])
def test_every_row_is_in_one_random_fold_and_no_fold_is_empty(count):
    q = np.random.default_rng(count).uniform(-1.0, 1.0, (count, 6))
    folds = random_folds(q)
    assert len(folds) == min(FOLDS, count)
    assert sorted(row for fold in folds for row in fold) == list(range(count))
    assert all(len(fold) for fold in folds)
    assert all(np.array_equal(*pair) for pair in zip(folds, random_folds(q), strict=True))  # the same ones each time


def test_repeats_of_a_posture_are_in_one_fold_wherever_they_are_among_the_rows():
    rng = np.random.default_rng(1)
    posture = rng.permutation(np.repeat(np.arange(30), 4))
    q = rng.uniform(-1.0, 1.0, (30, 6)).round(2)[posture] + rng.uniform(-1e-5, 1e-5, (120, 6))
    fold = np.zeros(120, int)
    for number, test in enumerate(random_folds(q)):
        fold[test] = number
    assert all(len(set(fold[posture == each])) == 1 for each in range(30))
    assert len(set(fold)) == FOLDS


def test_ends_are_the_quarters_of_the_rows_at_either_end_of_each_joint_that_moved():
    rng = np.random.default_rng(2)
    q = rng.uniform(-1.0, 1.0, (80, 3)) * [1.0, 0.05, 0.5]
    ends = end_folds(q)
    assert len(ends) == 4  # joint 2 moved by 0.1 rad
    for joint, (lower, upper) in zip((0, 2), (ends[:2], ends[2:]), strict=True):
        order = np.argsort(q[:, joint])
        assert set(lower) == set(order[:20])
        assert set(upper) == set(order[-20:])


def test_an_end_at_which_half_of_the_rows_are_is_none():
    q = np.concatenate([np.zeros(50), np.linspace(0.1, 1.0, 50)])[:, None]
    (upper,) = end_folds(q)
    assert set(upper) == set(range(75, 100))
