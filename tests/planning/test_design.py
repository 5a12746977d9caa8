"""Designs against plain formulas: each criterion from the information matrix, all subsets of few candidates, and fits
of simulated robots with the rows that were chosen.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

import cellctl
from cellctl.calibration import RobotModel
from cellctl.formats import RobotFile
from cellctl.operations.optimal_plan import Aim, OptimalChoice
from cellctl.planning import Reach, TargetOptions, TargetSet, TaskWorkspace, plan_targets
from cellctl.planning._target_sets import in_blocks
from cellctl.planning.design import CRITERIA, Criterion, Design, chosen_rows
from tests.helpers.arms import KR5_FILE, Floats
from tests.helpers.own_model import kr5

PARAMETERS = 4


def problem(seed: int, rows: int = 9) -> tuple[Floats, Floats, Floats]:
    """Prior covariance, candidates (rows, 2, P), derivatives of five places (15, P)."""
    rng = np.random.default_rng(seed)
    scale = np.array([3.0, 1.0, 0.5, 2.0])
    return np.diag(scale**2), rng.normal(size=(rows, 2, PARAMETERS)), rng.normal(size=(15, PARAMETERS))


def cost(criterion: Criterion, prior: Floats, candidates: Floats, asked: Floats, chosen: tuple[int, ...]) -> float:
    """The criterion after the rows `chosen`, from the sum of their information."""
    information = np.linalg.inv(prior) + sum(candidates[row].T @ candidates[row] for row in chosen)
    after = np.linalg.inv(information)
    places = asked.reshape(-1, 3, PARAMETERS)
    scaled = after / np.sqrt(np.outer(np.diag(prior), np.diag(prior)))
    return {
        "volume": float(np.mean([np.trace(each @ after @ each.T) for each in places])),
        "max": max(float(np.trace(each @ after @ each.T)) for each in places),
        "D": float(np.linalg.slogdet(after)[1]),
        "A": float(np.trace(scaled)),
        "G": max(float(np.trace(each @ after @ each.T)) for each in candidates),
    }[criterion]


@pytest.mark.parametrize("criterion", CRITERIA)
def test_a_gain_is_what_the_criterion_falls_by(criterion: Criterion) -> None:
    _, candidates, asked = problem(1)
    prior = np.eye(PARAMETERS)
    design = Design(prior, candidates, asked, criterion)
    for row in (4, 7, 2):
        design.measure(row)
    design.leave_out(7)
    now = cost(criterion, prior, candidates, asked, (4, 2))
    falls = [now - cost(criterion, prior, candidates, asked, (4, 2, row)) for row in range(len(candidates))]
    assert design.gains() == pytest.approx(falls, abs=1e-9)


@pytest.mark.parametrize("criterion", CRITERIA)
def test_of_few_candidates_the_choice_is_nearly_the_best_of_all(criterion: Criterion) -> None:
    """An exchange of single rows ends in a local optimum: mostly the best, of a largest variance one of the better."""
    ranks = []
    for seed in range(12):
        given = problem(seed)
        costs = sorted(cost(criterion, *given, rows) for rows in combinations(range(9), 3))
        found = chosen_rows(*given, 3, criterion)
        assert len(set(found.rows)) == 3
        ranks.append(int(np.searchsorted(costs, cost(criterion, *given, found.rows) - 1e-9)))
    assert np.median(ranks) <= (4 if criterion in ("max", "G") else 0), "of 84"
    assert np.mean(ranks) <= 8


def test_predicted_errors_are_those_of_the_information_matrix() -> None:
    prior, candidates, asked = problem(3, rows=40)
    found = chosen_rows(prior, candidates, asked, 6)
    assert found.sigma_mm**2 == pytest.approx(cost("volume", prior, candidates, asked, found.rows))
    assert found.largest_mm**2 == pytest.approx(cost("max", prior, candidates, asked, found.rows))
    left = [cost("volume", prior, candidates, asked, tuple(np.delete(found.rows, row))) for row in range(6)]
    assert (found.sigma_mm * (1.0 + found.rises)) ** 2 == pytest.approx(left, rel=1e-4)
    even = tuple(np.linspace(0, 39, 6).astype(int))
    assert found.even_sigma_mm**2 == pytest.approx(cost("volume", prior, candidates, asked, even))
    assert found.sigma_mm < found.even_sigma_mm


def test_exchanged_rows_give_what_their_information_gives() -> None:
    """Several rows in one step, others out: covariance, and gains without one row, are those of a fresh design."""
    _, candidates, asked = problem(7, rows=20)
    prior = np.eye(PARAMETERS)
    design = Design(prior, candidates, asked)
    design.exchange((), (1, 5, 9, 12))
    design.exchange((5, 9), (3,))
    fresh = Design(prior, candidates, asked)
    for row in (1, 3, 12):
        fresh.measure(row)
    assert design.covariance == pytest.approx(fresh.covariance, abs=1e-12)
    without = design.gains_without(12)
    fresh.leave_out(12)
    assert without == pytest.approx(fresh.gains(), abs=1e-9)


def test_rows_that_no_other_checks_get_one_beside_them() -> None:
    """One parameter that the best rows see in one row alone: with a limit a second row sees it."""
    rng = np.random.default_rng(4)
    candidates = np.concatenate([0.05 * rng.normal(size=(60, 1, 3)), rng.normal(size=(60, 1, 3))])
    candidates[:, :, 2] = 0.0
    candidates[[100, 110], 0] = [0.0, 0.0, 30.0], [0.0, 0.0, 3.0]
    prior, asked = 100.0 * np.eye(3), np.tile(np.eye(3), (4, 1))
    free, limited = (chosen_rows(prior, candidates, asked, 9, most_rise=most) for most in (None, 0.5))
    assert 100 in free.rows
    assert free.rises.max() > 2.0 > 0.5 >= limited.rises.max()
    assert {100, 110} <= set(limited.rows)
    assert limited.sigma_mm < 1.5 * free.sigma_mm
    assert free.leverage[free.rows.index(100)] == pytest.approx(1.0, abs=1e-3)
    total = sum(candidates[row].T @ candidates[row] for row in limited.rows)
    after = np.linalg.inv(np.linalg.inv(prior) + total)
    hat = [float((candidates[row] @ after @ candidates[row].T)[0, 0]) for row in limited.rows]
    assert limited.leverage == pytest.approx(hat, abs=1e-4)


def test_the_check_is_by_the_parameters_that_the_model_has_for_certain() -> None:
    prior, candidates, asked = problem(9, rows=40)
    core = np.array([True, True, False, True])
    found = chosen_rows(prior, candidates, asked, 5, core=core)
    alone = chosen_rows(prior[np.ix_(core, core)], candidates[found.rows, :][:, :, core], asked[:, core], 5)
    assert found.rises == pytest.approx(alone.rises, rel=1e-3)


def test_parameters_that_no_row_shows_keep_their_part_of_the_error() -> None:
    prior, candidates, asked = problem(5, rows=30)
    candidates[..., 3] = 0.0
    found = chosen_rows(prior, candidates, asked, 5)
    assert found.sigma_mm**2 == pytest.approx(cost("volume", prior, candidates, asked, found.rows))
    assert found.sigma_mm**2 > np.mean(np.sum(asked[:, 3].reshape(-1, 3) ** 2, axis=1)) * prior[3, 3]


def test_a_drift_over_the_measurement_is_no_error_of_a_place() -> None:
    """In blocks the mean place of each third of the time is that of all; the way is shorter than at random."""
    rng = np.random.default_rng(2)
    readings = rng.uniform(-90.0, 90.0, (120, 6))
    order = in_blocks(readings, np.random.default_rng(1))
    assert sorted(order) == list(range(120))
    ordered = readings[order]
    thirds = ordered.reshape(3, 40, 6).mean(axis=1) - readings.mean(axis=0)
    assert np.abs(thirds).max() < 3.5 * 52.0 / np.sqrt(40.0)

    def way(path: Floats) -> float:
        return float(np.abs(np.diff(path, axis=0)).max(axis=1).sum())

    assert way(ordered) < 0.8 * way(readings)


REGION = TaskWorkspace.of([(850, 1250), (-300, 300), (200, 600), (-60, 60), (120, 180), (-40, 40)])


def planned(method: str, count: int, choose: OptimalChoice | None = None) -> TargetSet:
    robot = RobotFile.load(KR5_FILE)
    reach = Reach(*(tuple(each) for each in robot.limits().T.tolist()))
    options = TargetOptions(dense=1500, choose=choose) if choose else None
    return plan_targets(robot.chain(), robot.joint_map(), reach, REGION, method, count, 0, 4, options)  # type: ignore[arg-type]


@pytest.mark.long
def test_robots_identified_with_the_chosen_rows_are_as_good_as_predicted() -> None:
    """RMS error among 200 places, of 8 robots with errors drawn from the priors, measured by an independent model."""
    choice = OptimalChoice(RobotFile.load(KR5_FILE), Aim(model="geometry", sigma_mm=0.03))
    best, even = planned("optimal", 24, choice), planned("quasi-random", 24)
    judges = planned("pseudo-random", 200)
    assert choice.figures is not None
    errors = {name: [] for name in ("best", "even")}
    for seed in range(8):
        for name, targets in (("best", best), ("even", even)):
            errors[name].append(identified_error(seed, targets, judges))
    found = {name: float(np.sqrt(np.mean(np.square(each)))) for name, each in errors.items()}
    # 8 robots with some ten free shapes each: their mean square has a standard deviation of about 16 %
    assert found["best"] == pytest.approx(choice.figures.sigma_mm, rel=0.3)
    assert found["best"] < found["even"]


def identified_error(seed: int, targets: TargetSet, judges: TargetSet) -> float:
    """RMS distance, mm, between true and identified places of `judges`, the best rigid fit removed."""
    rng = np.random.default_rng(seed)
    robot = RobotFile.load(KR5_FILE)
    names = [each.name for each in RobotModel(robot.chain()).parameters if each.group in ("zeros", "links")]
    sigma = np.array([np.deg2rad(0.05) if name.startswith(("theta", "alpha", "beta")) else 0.5 for name in names])
    true = kr5().moved(names, list(rng.normal(size=len(names)) * sigma))
    joints = robot.joint_map()
    noise = float(np.hypot(0.03, robot.repeatability / np.sqrt(3.0)))
    measured = true.points(joints.model(targets.readings)) + rng.normal(0.0, noise, (len(targets), 3))
    data = {f"A{axis + 1}": targets.readings[:, axis] for axis in range(6)}
    data |= dict(zip("XYZ", measured.T, strict=True))
    model = cellctl.fit(KR5_FILE, data, model="geometry", folds=2, check=False)
    places = true.points(joints.model(judges.readings))
    found = model.predict(judges.readings).positions
    middle = places.mean(axis=0), found.mean(axis=0)
    u, _, vt = np.linalg.svd((found - middle[1]).T @ (places - middle[0]))
    turn = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
    return float(np.sqrt(np.mean(np.sum(((found - middle[1]) @ turn - (places - middle[0])) ** 2, axis=1))))


def test_a_row_that_no_other_checks_has_a_rise_and_a_task_of_one_place_has_none():
    """A leverage of 1 to seven digits, as a fit of few touches has it: single precision would divide by 0."""
    alone = np.full((2, 1, 1), 3e4)
    rows = np.concatenate([np.pad(alone[:1], ((0, 0), (0, 0), (0, 1))), np.pad(alone[1:], ((0, 0), (0, 0), (1, 0)))])
    found = chosen_rows(np.eye(2), rows, np.eye(3, 2), 2)
    np.testing.assert_allclose(found.leverage, 1.0, atol=1e-6)
    # without one of them its parameter has its prior's variance again: (1 + 1/9e8) against 2/9e8
    np.testing.assert_allclose(found.rises, np.sqrt((1 + 1 / 9e8) / (2 / 9e8)) - 1, rtol=1e-3)
    assert not chosen_rows(np.eye(2), rows, np.zeros((3, 2)), 2).rises.any()
