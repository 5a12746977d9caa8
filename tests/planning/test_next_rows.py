"""What to measure next: the arithmetic against inverses written out here, the rows against what they promise."""

from pathlib import Path

import numpy as np
import pytest

from cellctl.calibration import PoseRows, PositionRows, Postures, SocketRows, State, Task, TouchRows, identify
from cellctl.calibration.prediction.predict import REGION_POINTS, shape_columns, sigma_over_region
from cellctl.formats import RobotFile, nominal_model
from cellctl.kinematics.low_discrepancy import spread_over
from cellctl.planning.next_rows import led_to, next_rows, rows_like

KR5 = RobotFile.load(Path(__file__).parents[2] / "procedures" / "robots" / "kr5_r1400.yaml")
CENTRE = np.array([[1000.0, 0.0, 400.0]])


@pytest.fixture
def problem():
    """A covariance of six parameters, eight points asked for, thirty candidates of two numbers each."""
    rng = np.random.default_rng(4)
    root = rng.normal(size=(6, 6))
    return root @ root.T, rng.normal(size=(24, 6)), rng.normal(size=(30, 2, 6))


def mean_sigma(covariance, asked):
    return np.sqrt(np.trace(asked @ covariance @ asked.T) / (len(asked) / 3))


def with_rows(covariance, rows):
    """Information added up and inverted, as every textbook has it."""
    return np.linalg.inv(np.linalg.inv(covariance) + sum(row.T @ row for row in rows))


def test_each_row_is_the_best_of_all_that_are_left(problem):
    covariance, asked, candidates = problem
    advice = next_rows(covariance, asked, candidates, 4)
    taken = []
    for chosen in advice.chosen:
        left = [index for index in range(30) if index not in taken]
        tried = [mean_sigma(with_rows(covariance, candidates[[*taken, index]]), asked) for index in left]
        assert chosen == left[int(np.argmin(tried))]
        taken.append(chosen)


def test_the_sigma_promised_after_each_row_is_that_of_the_information_added_up(problem):
    covariance, asked, candidates = problem
    advice = next_rows(covariance, asked, candidates, 5)
    expected = [mean_sigma(with_rows(covariance, candidates[list(advice.chosen[:n])]), asked) for n in range(1, 6)]
    assert advice.sigma_mm[0] == pytest.approx(mean_sigma(covariance, asked))
    assert advice.sigma_mm[1:] == pytest.approx(expected, rel=1e-9)
    assert np.all(np.diff(advice.sigma_mm) < 0)


def test_what_a_row_narrows_is_the_fall_of_each_parameters_sigma(problem):
    covariance, asked, candidates = problem
    advice = next_rows(covariance, asked, candidates, 2)
    first = with_rows(covariance, candidates[[advice.chosen[0]]])
    second = with_rows(covariance, candidates[list(advice.chosen)])
    assert advice.narrowed[0] == pytest.approx(np.sqrt(np.diag(first) / np.diag(covariance)))
    assert advice.narrowed[1] == pytest.approx(np.sqrt(np.diag(second) / np.diag(first)))


def test_no_row_is_named_twice_and_no_more_than_there_are(problem):
    covariance, asked, candidates = problem
    advice = next_rows(covariance, asked, candidates[:3], 8)
    assert sorted(advice.chosen) == [0, 1, 2]


def test_parameters_that_are_held_stay_held(problem):
    covariance, asked, candidates = problem
    covariance[2], covariance[:, 2] = 0.0, 0.0
    assert next_rows(covariance, asked, candidates, 3).narrowed[:, 2] == pytest.approx(1.0)


def test_without_candidates_there_is_no_advice():
    advice = next_rows(np.eye(3), np.eye(3), np.zeros((0, 2, 3)), 8)
    assert advice.chosen == ()
    assert advice.at_random_mm == pytest.approx(advice.sigma_mm[0])


@pytest.fixture(scope="module")
def limits():
    return np.sort(KR5.joint_map().model(KR5.limits().T), axis=0).T


@pytest.fixture(scope="module")
def model():
    return nominal_model(KR5, touched=False)


@pytest.fixture(scope="module")
def touches(model, limits):
    """Thirty touches on the upper half of one sphere."""
    rng = np.random.default_rng(7)
    start = KR5.joint_map().model(np.array([0.0, -60.0, 90.0, 0.0, 60.0, 0.0]))
    normals = rng.normal(size=(60, 3)) * 0.5 + [0.0, 0.0, 1.0]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    q, there = led_to(model, start + rng.normal(0.0, 0.3, (60, 6)), CENTRE + 31.3 * normals)
    q = q[there & ((q > limits[:, 0]) & (q < limits[:, 1])).all(axis=1)][:30]
    return TouchRows(q, np.zeros(len(q), int), np.full(len(q), 31.3), np.full((len(q), 1), 0.02))


def test_the_tool_is_led_to_where_it_should_be(model):
    rng = np.random.default_rng(1)
    start = KR5.joint_map().model(rng.uniform([-30, -80, 60, -40, 30, -90], [30, -40, 110, 40, 80, 90], (20, 6)))
    wanted = model.tcp(start) + rng.uniform(-100.0, 100.0, (20, 3))
    q, there = led_to(model, start, wanted)
    assert there.mean() > 0.9
    assert np.linalg.norm(model.tcp(q) - wanted, axis=1)[there].max() < 1e-3


def test_touches_proposed_are_on_the_sphere_within_the_limits_and_from_the_sides_that_were_touched(
    model, touches, limits
):
    state = State.alone(model, CENTRE)
    like = rows_like(touches, state, limits, 100)
    assert len(like) >= 50
    assert np.abs(like.residual(state)).max() < 2e-3
    assert np.all((like.q >= limits[:, 0]) & (like.q <= limits[:, 1]))
    seen, proposed = (block_normals(model, block) for block in (touches, like))
    middle = seen.mean(axis=0) / np.linalg.norm(seen.mean(axis=0))
    assert (proposed @ middle).min() >= (seen @ middle).min() - 1e-4


def block_normals(model, block):
    away = model.tcp(block.q) - CENTRE
    return away / np.linalg.norm(away, axis=1, keepdims=True)


def test_positions_proposed_lie_about_the_volume_that_was_measured(model, limits):
    q = KR5.joint_map().model(
        np.random.default_rng(2).uniform([-40, -90, 60, -60, 20, -90], [40, -50, 100, 60, 80, 90], (40, 6))
    )
    tips = model.tcp(q)
    block = PositionRows(q, tips, np.full((40, 3), 0.05))
    like = rows_like(block, State.alone(model), limits, 200)
    room = 0.1 * np.linalg.norm(np.ptp(tips, axis=0)) + 1e-9
    assert len(like) == 200
    assert np.all(model.tcp(like.q) >= tips.min(axis=0) - room)
    assert np.all(model.tcp(like.q) <= tips.max(axis=0) + room)
    assert np.all((like.q >= limits[:, 0]) & (like.q <= limits[:, 1]))


@pytest.mark.parametrize("kind", ["pose", "socket"])
def test_other_kinds_are_proposed_as_they_were_measured(model, limits, touches, kind):
    block = (
        PoseRows(touches.q, model.pose(touches.q), np.full((len(touches), 6), 0.05))
        if kind == "pose"
        else SocketRows(
            led_to(model, touches.q, np.repeat(CENTRE, len(touches), 0))[0],
            touches.point,
            np.full((len(touches), 3), 0.05),
        )
    )
    state = State.alone(model, CENTRE if kind == "socket" else np.zeros((0, 3)))
    like = rows_like(block, state, limits, 64)
    assert type(like) is type(block)
    assert len(like) >= 16
    assert np.abs(like.residual(state)).max() < 2e-3


def test_conditions_are_such_as_there_were(model, limits, touches):
    count = len(touches)
    at = Postures(touches.q, np.ones((count, 6)), np.linspace(0.0, 8.0, count), np.full(count, 5.0))
    block = PositionRows(at, model.tcp(touches.q), np.full((count, 3), 0.05))
    like = rows_like(block, State.alone(model), limits, 64).postures
    assert set(np.unique(like.approach)) == {-1.0, 1.0}
    assert like.delta_t == pytest.approx(np.full(len(like), 4.0))
    assert like.payload == pytest.approx(np.full(len(like), 5.0))


def test_rows_measured_as_advised_narrow_the_model_as_promised_and_more_than_others(model, limits):
    """A fit of 20 positions, the advised six measured as well, and the fit of all 26 asked for its own σ."""
    rng = np.random.default_rng(3)
    low, high = KR5.joint_map().model(np.array([[-40, -90, 60, -60, 20, -90], [40, -50, 100, 60, 80, 90]]))
    lower, upper = np.minimum(low, high), np.maximum(low, high)
    q, sigma = rng.uniform(lower, upper, (20, 6)), np.full((20, 3), 0.05)
    task = Task(model, PositionRows(q, model.tcp(q) + rng.normal(0.0, 0.05, (20, 3)), sigma))
    found = identify(task).identified
    like = rows_like(task.rows.only, found.state, limits, 256)
    asked = shape_columns(found.state.model, spread_over(lower, upper, REGION_POINTS, scramble=False))
    columns = like.jacobian(found.state) / like.sigma[..., None]
    advice = next_rows(found.covariance, asked, columns, 6)
    more = np.concatenate([q, like.q[list(advice.chosen)]])
    again = identify(
        Task(model, PositionRows(more, model.tcp(more) + rng.normal(0.0, 0.05, (26, 3)), np.full((26, 3), 0.05)))
    )
    robot = again.identified
    promised = sigma_over_region(robot.state.model, robot.covariance, lower, upper)
    assert advice.sigma_mm[-1] == pytest.approx(promised, rel=0.03)
    assert advice.sigma_mm[-1] < advice.at_random_mm < advice.sigma_mm[0]
