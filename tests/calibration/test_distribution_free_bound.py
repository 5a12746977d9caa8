"""A bound from the rows alone holds for new rows, whatever their errors are distributed like."""

from dataclasses import replace

import numpy as np
import pytest

from cellctl.calibration import PositionRows, RowBlocks, Split, Task, fit
from cellctl.formats import nominal_model
from tests.helpers.honesty import task_of
from tests.helpers.simulated_setups import sph
from tests.helpers.unmodelled import TUNING

ROWS, NEW = 60, 400
LOW, HIGH = np.array([-60, -100, 50, -90, -80, -90.0]), np.array([60, -40, 110, 90, 80, 90.0])


def measured(kr5, seed, scatter):
    """ROWS + NEW positions of a KR5; scatter(rng, N): their errors (N, 3), mm."""
    rng = np.random.default_rng([seed, 67])
    nominal = nominal_model(kr5, touched=False)
    true = nominal.with_deviations(rng.normal(0.0, np.where(nominal.parameter_turns, 3e-4, 0.2)))
    q = kr5.joint_map().model(rng.uniform(LOW, HIGH, (ROWS + NEW, 6)))
    xyz = true.tcp(q) + scatter(rng, len(q))
    return nominal, PositionRows(q, xyz, np.full(xyz.shape, 0.02))


def bounded(nominal, rows, count=ROWS):
    task = Task(nominal, RowBlocks.of(rows.pick(np.arange(count))))
    return fit(task, Split(np.arange(count), ()))


@pytest.mark.parametrize(
    "scatter",
    [
        lambda rng, count: rng.normal(0.0, 0.02, (count, 3)),
        lambda rng, count: 0.02 * rng.standard_t(2.5, (count, 3)),
    ],
    ids=["normal", "heavy tails"],
)
def test_new_points_are_inside_as_often_as_guaranteed(kr5, scatter):
    inside = []
    for seed in range(5):
        nominal, rows = measured(kr5, seed, scatter)
        result = bounded(nominal, rows)
        new = rows.pick(np.arange(ROWS, ROWS + NEW))
        bounds = result.distribution_free.at(new)
        known = np.isfinite(bounds)
        assert known.mean() > 0.5
        inside.append(np.mean(new.errors(result.identification.identified.state)[known] <= bounds[known]))
    assert 0.88 < result.distribution_free.guarantee <= 0.9
    assert np.mean(inside) >= 0.9


def test_far_from_the_measured_postures_nothing_is_known(kr5):
    nominal, rows = measured(kr5, 1, lambda rng, count: rng.normal(0.0, 0.02, (count, 3)))
    far = replace(rows, at=rows.q + np.array([0.0, 0.0, 0.0, 4.0, 4.0, 4.0]))
    assert np.isnan(bounded(nominal, rows).distribution_free.at(far)).all()


def test_eighteen_rows_give_no_bound_and_say_so(kr5):
    nominal, rows = measured(kr5, 1, lambda rng, count: rng.normal(0.0, 0.02, (count, 3)))
    bound = bounded(nominal, rows, 18).distribution_free
    assert bound.summary()["bins"] == []
    assert bound.unknown == "18 rows, 19 at least"


@pytest.mark.long
def test_touches_bound_the_distance_along_the_normal_of_other_touches():
    inside = []
    for seed in range(1000, 1006):
        draw = sph(seed, besides=TUNING["these three"](seed))
        task = task_of(draw)
        result = fit(task, Split.by_column(np.arange(len(draw.rows.q)) >= 40))
        assert result.distribution_free.summary()["of"] == "distance along the normal"
        held_out = task.rows.pick(np.arange(40, 50)).only
        bounds = result.distribution_free.at(held_out)
        known = np.isfinite(bounds)
        inside += (result.test_errors[known] <= bounds[known]).tolist()
    assert len(inside) > 30
    assert np.mean(inside) >= 0.8  # 0.9 less two standard errors of 50 touches
