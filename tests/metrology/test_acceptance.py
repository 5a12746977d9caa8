"""Figures of errors cover the true figure as often as they state, and decisions keep their guard band."""

import numpy as np
import pytest

from cellctl.metrology.acceptance import MEASURANDS, decision, measured_figure

RUNS = 600


def space(random, *shape):
    return np.linalg.norm(random.normal(size=(*shape, 3)), axis=-1)


def line(random, *shape):
    return np.abs(random.normal(size=shape))


def flat(random, *shape):
    return np.linalg.norm(random.normal(size=(*shape, 3)) * [1.0, 0.5, 0.1], axis=-1)


def heavy(random, *shape):
    """Places whose scale varies by a factor of 1.5, up and down."""
    scale = np.exp(0.4 * random.normal(size=(*shape, 1)))
    return np.linalg.norm(random.normal(size=(*shape, 3)) * scale, axis=-1)


def figure(measurand, errors, shared=0.0, single=0.1):
    return measured_figure(measurand, errors, shared_mm=shared, single_mm=single, single_factor=1.96)


@pytest.mark.parametrize("draw", [space, line, flat, heavy])
@pytest.mark.parametrize("measurand", ["mean", "quantile_95"])
def test_u_covers_the_true_figure_of_all_places_at_about_95_percent(draw, measurand):
    random = np.random.default_rng(11)
    everywhere = draw(random, 400_000)
    truth = everywhere.mean() if measurand == "mean" else np.quantile(everywhere, 0.95)
    found = [figure(measurand, errors) for errors in draw(random, RUNS, 30)]
    covered = np.mean([abs(truth - each.value_mm) <= each.expanded_mm for each in found])
    beyond = np.mean([truth - each.value_mm > each.expanded_mm for each in found])
    assert 0.90 <= covered <= 0.995
    assert beyond <= 0.09


def test_u_of_the_maximum_covers_the_greatest_true_error_of_the_places():
    random = np.random.default_rng(12)
    truth = line(random, RUNS, 30)
    measured = np.abs(truth + random.normal(0.0, 0.1, truth.shape))
    found = [figure("maximum", errors) for errors in measured]
    off = np.abs(truth.max(axis=1) - [each.value_mm for each in found])
    assert np.mean(off <= [each.expanded_mm for each in found]) > 0.93


def test_a_part_that_all_errors_share_is_not_reduced_by_more_places():
    random = np.random.default_rng(13)
    for measurand in ("mean", "quantile_95"):
        found = figure(measurand, space(random, 1000), shared=0.3)
        assert found.standard_mm == pytest.approx(0.3, rel=0.02)
        assert found.factor == pytest.approx(1.96, abs=0.01)


def test_the_mean_has_students_interval():
    errors = np.array([0.1, 0.2, 0.4])
    found = figure("mean", errors)
    assert (found.value_mm, found.standard_mm) == pytest.approx((0.7 / 3.0, errors.std(ddof=1) / np.sqrt(3.0)))
    assert found.factor == pytest.approx(4.3027, abs=1e-4)


def test_the_share_below_the_greatest_error_is_wilks_bound():
    assert figure("maximum", np.linspace(0.1, 0.2, 59)).share_below == pytest.approx(0.95, abs=0.001)


def test_errors_that_are_all_alike_have_no_scatter():
    for measurand in MEASURANDS:
        assert figure(measurand, np.full(20, 0.2)).value_mm == pytest.approx(0.2, rel=1e-4)


@pytest.mark.parametrize("errors", [[], [0.1], [0.0] * 30, [0.1, np.nan] * 15, [-0.1, 0.1] * 15])
def test_too_few_and_impossible_errors_are_refused(errors):
    with pytest.raises(ValueError, match="error"):
        figure("quantile_95", errors)


@pytest.mark.parametrize(
    ("value", "band", "word"),
    [(0.10, 0.10, "accepted"), (0.11, 0.10, "no decision"), (0.30, 0.10, "no decision"), (0.31, 0.10, "rejected")],
)
def test_the_guard_band_is_kept_on_both_sides_of_the_limit(value, band, word):
    assert decision(value, band, 0.2) == word
    assert decision(value, 0.0, 0.2) == ("accepted" if value <= 0.2 else "rejected")
