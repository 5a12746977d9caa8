"""What held-out rows are predicted to be without a new fit, against fits of the other rows."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from cellctl.calibration import PositionRows, Task, estimate
from cellctl.calibration.folds import random_folds
from cellctl.calibration.identification.identify import nominal_start
from cellctl.calibration.selection.cross_validation import Folded
from cellctl.formats import nominal_model

SIGMA, ROWS = 0.02, 60


@pytest.fixture(scope="module")
def folded(kr5):
    """Rows of a KR5 with errors, its unknowns fitted to all of them, and five folds linearised there."""
    rng = np.random.default_rng(8)
    nominal = nominal_model(kr5, touched=False)
    q = kr5.joint_map().model(rng.uniform([-90, -110, 40, -90, -80, -120], [90, -40, 120, 90, 80, 120], (ROWS, 6)))
    turns = nominal.parameter_turns
    true = nominal.with_deviations(rng.normal(0.0, np.where(turns, 5e-4, 0.3)))
    sigma = rng.choice([1.0, 3.0], (ROWS, 3)) * SIGMA
    task = Task(nominal, PositionRows(q, true.tcp(q) + rng.normal(0.0, sigma), sigma))
    unknowns = nominal_start(task, task.rows)
    found = estimate(unknowns, task.rows.blocks)
    folds = random_folds(q)
    return (
        task,
        found,
        folds,
        Folded.of(unknowns, found.deviations, task.rows, [], folds, task.registration_parameters(unknowns)),
    )


def refitted(found, rows, test, kept, noise, scale):
    """Residuals (k,) and covariance of the rows `test`, in σ, by SVD of the others' linear equations, written here."""
    unknowns = found.unknowns
    free = np.flatnonzero(unknowns.free)
    columns = rows.jacobian(found.state)[..., free] * unknowns.sigma[free] / rows.sigma[..., None]
    away = rows.residual(found.state) / rows.sigma - columns @ (found.deviations[free] / unknowns.sigma[free])
    columns, others = columns[..., kept], np.delete(np.arange(len(rows)), test)
    lines = np.vstack([columns[others].reshape(-1, kept.sum()) / noise, np.diag(1.0 / scale[kept])])
    right = np.concatenate([-away[others].ravel() / noise, np.zeros(kept.sum())])
    left, singular, turned = np.linalg.svd(lines, full_matrices=False)
    x = turned.T @ ((left.T @ right) / singular)
    moved = columns[test] @ (turned.T / singular)
    covariance = moved @ np.swapaxes(moved, 1, 2) + noise**2 * np.eye(3)
    return away[test] + columns[test] @ x, covariance


@pytest.mark.parametrize("part", ["all unknowns", "registration alone"])
def test_each_fold_is_predicted_as_by_equations_of_the_other_rows_alone(folded, part):
    task, found, folds, given = folded
    groups = np.array(found.unknowns.groups)[found.unknowns.free]
    kept = given.registering if part == "registration alone" else np.ones(groups.size, bool)
    assert 0 < kept.sum() <= groups.size
    logs = {("noise", 0): np.log(1.7), ("links", 0): np.log(2.5)}
    scale = np.where(groups == "links", 2.5, 1.0)
    said = given.predicted(kept, logs)
    assert sorted(said.rows.tolist()) == list(range(ROWS))
    parts = [refitted(found, task.rows.only, test, kept, 1.7, scale) for test in folds]
    residual, covariance = (np.concatenate(each) for each in zip(*parts, strict=True))
    assert_allclose(said.residual, residual, atol=1e-6 * np.abs(residual).max())
    assert_allclose(said.covariance, covariance, atol=1e-6 * np.abs(covariance).max())
    assert_allclose(said.errors, np.linalg.norm(residual * task.rows.only.sigma[said.rows], axis=1), rtol=1e-5)


def test_each_fold_is_predicted_as_by_a_fit_of_the_other_rows(folded):
    task, found, folds, given = folded
    rows = task.rows.only
    said = given.predicted(np.ones(int(found.unknowns.free.sum()), bool), {})
    errors = []
    for test in folds:
        again = estimate(found.unknowns, [rows.pick(np.delete(np.arange(ROWS), test))])
        errors.append(np.linalg.norm(rows.pick(test).residual(again.state), axis=1))
    assert_allclose(said.errors, np.concatenate(errors), rtol=0, atol=1e-6)


def test_of_each_fold_no_more_rows_are_looked_at_than_asked_for(folded):
    *_, given = folded
    kept = np.ones(given.registering.size, bool)
    whole, some = given.predicted(kept, {}), given.predicted(kept, {}, 4)
    assert len(some.rows) == 4 * len(given.folds)
    place = [whole.rows.tolist().index(row) for row in some.rows]
    assert_allclose(some.errors, whole.errors[place])


def test_base_and_tool_that_no_other_row_tells_of_are_found_from_the_held_out_rows(folded):
    """All rows in one fold: what is left is the error of nominal, registered."""
    task, found, _, given = folded
    alone = given.with_folds([np.arange(ROWS)]).predicted(np.ones(given.registering.size, bool), {})
    assert alone.placed.all()
    nominal = estimate(found.unknowns.masked(task.registration_parameters(found.unknowns)), task.rows.blocks)
    error = np.linalg.norm(task.rows.only.residual(nominal.state), axis=1)
    assert np.sqrt(np.mean(alone.errors**2)) < 1.1 * np.sqrt(np.mean(error**2))
