"""Correlation of distances and Mantel test against independent computations and known fields."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from scipy.stats import binomtest, pearsonr

from cellctl.analysis import ErrorSet, UnsuitableRows, mantel, similarity
from cellctl.formats.similarity_report import RobotErrors, result_sentences, similarity_report

RNG = np.random.default_rng(3)
READINGS = RNG.uniform(-40.0, 40.0, (50, 6))
PLACES = RNG.uniform(0.0, 800.0, (50, 3))


def in_pairs(values):
    return np.array([np.linalg.norm(values[i] - values[j]) for i, j in combinations(range(len(values)), 2)])


def errors_of(readings, noise=0.02, seed=1):
    """Errors that depend on joints 2 and 3, smoothly."""
    angles = np.radians(readings)
    field = np.column_stack([np.sin(2 * angles[:, 1]), np.cos(2 * angles[:, 2]), angles[:, 1]])
    return field + np.random.default_rng(seed).normal(0.0, noise, field.shape)


def test_the_correlation_is_pearsons_over_all_pairs_and_its_usual_p_value_that_of_scipy():
    errors = errors_of(READINGS)
    found = mantel(errors, {"Dq": READINGS, "Dp": PLACES}, 99, np.random.default_rng(1))
    for space, points in (("Dq", READINGS), ("Dp", PLACES)):
        wanted = pearsonr(in_pairs(errors), in_pairs(points))
        assert found[space].r == pytest.approx(wanted.statistic)
        assert found[space].p_if_independent == pytest.approx(wanted.pvalue, rel=1e-6)
        assert found[space].pairs == 1225


def test_errors_of_the_joints_are_alike_at_near_joints_and_not_at_near_places():
    found = similarity(ErrorSet.of(READINGS, PLACES, errors_of(READINGS)), 999).correlation["3-D"]
    assert found["Dq"].r > 0.2
    assert found["Dq"].p <= 0.002
    assert found["Dp"].p > 0.05


@pytest.mark.long
def test_the_mantel_test_keeps_its_level_where_a_test_of_independent_pairs_does_not():
    """Errors without any relation to the joints, but with some rows far off: 200 times."""
    wrong_mantel = wrong_pairs = 0
    for seed in range(200):
        rng = np.random.default_rng([seed, 1])
        readings, errors = rng.normal(size=(30, 6)), rng.standard_t(3, (30, 3))
        found = mantel(errors, {"Dq": readings}, 199, rng)["Dq"]
        wrong_mantel += found.p <= 0.05
        wrong_pairs += found.p_if_independent <= 0.05
    assert binomtest(wrong_mantel, 200, 0.05).pvalue > 0.01
    assert wrong_pairs > 40


def test_the_permuted_correlations_are_about_zero_and_the_same_seed_gives_the_same():
    rows = ErrorSet.of(READINGS, PLACES, errors_of(READINGS))
    first, again, other = (similarity(rows, 199, seed).correlation["3-D"]["Dp"] for seed in (1, 1, 2))
    assert first == again != other
    assert first.low_95 < 0.0 < first.high_95


def test_joints_that_the_errors_depend_on_rise_and_the_others_do_not():
    readings = np.random.default_rng(8).uniform(-40, 40, (150, 6))
    found = similarity(ErrorSet.of(readings, PLACES[np.arange(150) % 50], errors_of(readings)), 99)
    rise = {joint: each.gamma[8:14].mean() - each.gamma[:4].mean() for joint, each in found.by_joint["x"].items()}
    assert rise[2] > 0.5 > 3 * max(abs(value) for joint, value in rise.items() if joint != 2)
    near = found.by_joint_near["y"]
    assert near[3].pairs.sum() == pytest.approx(0.1 * 150 * 149 / 2, abs=1)


def test_repeats_of_a_posture_are_averaged():
    readings, errors = np.repeat(READINGS, 2, axis=0), np.repeat(errors_of(READINGS), 2, axis=0)
    errors[::2] += np.array([0.1, 0.0, -0.2])
    found = ErrorSet.of(readings, np.repeat(PLACES, 2, axis=0), errors)
    assert (len(found), found.repeats) == (50, 50)
    assert np.allclose(found.errors, errors_of(READINGS) + np.array([0.05, 0.0, -0.1]))
    assert np.array_equal(found.readings, READINGS)


def test_a_joint_that_never_moves_and_a_constant_component_are_left_out_of_the_semivariograms():
    readings, errors = READINGS.copy(), errors_of(READINGS)
    readings[:, 5], errors[:, 1] = 12.0, 0.3
    rows = ErrorSet.of(readings, PLACES, errors)
    found = similarity(rows, 99)
    assert rows.moving == (True,) * 5 + (False,)
    assert set(found.by_joint["x"]) == {1, 2, 3, 4, 5}
    assert set(found.overall) == {"x", "z"}
    assert set(found.correlation) == {"3-D", "x", "z"}


def test_places_that_are_all_the_same_have_no_correlation():
    found = mantel(errors_of(READINGS), {"Dp": np.zeros((50, 3))}, 99, np.random.default_rng(1))["Dp"]
    assert np.isnan(found.r)
    assert found.p == 1.0


@pytest.mark.parametrize(
    ("readings", "errors", "words"),
    [
        (READINGS[:10], errors_of(READINGS[:10]), "10 different postures are too few for 20 bins"),
        (np.repeat(READINGS[:10], 5, axis=0), errors_of(np.repeat(READINGS[:10], 5, axis=0)), "40 rows repeat one"),
        (READINGS, np.zeros((50, 3)), "computed and not measured"),
    ],
)
def test_rows_that_allow_no_analysis_are_refused_with_the_reason(readings, errors, words):
    with pytest.raises(UnsuitableRows, match=words):
        ErrorSet.of(readings, np.resize(PLACES, (len(readings), 3)), errors)


@pytest.mark.parametrize("named", [False, True], ids=["alike within 4 degrees", "a slope over the whole range"])
def test_a_semivariogram_that_never_reaches_its_sill_is_named(named):
    rng = np.random.default_rng(4)
    readings = rng.uniform(-40.0, 40.0, (200, 2)) * [1.0, 0.0]
    steps = rng.normal(size=30)[np.floor(readings[:, 0] / 4.0).astype(int)]
    field = np.outer(readings[:, 0] / 20.0 if named else steps, [1.0, 0.0, 0.0])
    errors = ErrorSet.of(readings, np.zeros((200, 3)), field + rng.normal(0.0, 1e-3, (200, 3)))
    report = similarity_report(RobotErrors(errors, 200, 200, (), 0, ()), similarity(errors, 99), 0)
    words = " ".join(result_sentences(report))
    assert ("still rise at the greatest distance" in words and "x (range " in words and "x over A1" in words) is named
