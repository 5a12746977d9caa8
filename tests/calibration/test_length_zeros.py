"""Draw-wires and bars whose zero nobody knows: it is found with everything else, and as well as is said."""

from dataclasses import replace

import numpy as np
import pytest

from cellctl.calibration import (
    PositionRows,
    RobotModel,
    Session,
    SocketRows,
    Split,
    State,
    Task,
    Tolerances,
    ToolDeflection,
    TouchRows,
    Unknowns,
    fit,
    identify,
)
from cellctl.kinematics import pose_from_xyz_abc
from tests.helpers.own_campaigns import Campaign, nominal_of, shape_error

ANCHORS = np.array([[1500.0, 600.0, 100.0], [1300.0, -900.0, 1500.0]])
WIRES = ("W1", "W2")
NOT_KNOWN = -1
TO_OWN_ANCHOR, TO_BOTH_ANCHORS = [(0, 0), (1, 1)], [(0, 0), (0, 1)]
BESIDE_AN_ABSOLUTE_ONE = [(0, 0), (1, 1), (NOT_KNOWN, 0)]
SEEDS = 20


def at_home(seed):
    """A campaign in the robot's own base, and what two wires show at no length, mm."""
    campaign = Campaign.of(seed)
    return replace(campaign, truth=replace(campaign.truth, base=np.eye(4))), campaign.rng.uniform(-500.0, 500.0, 2)


def lengths(campaign, zeros, count, pairs, sigma=0.05):
    """Rows of wire and anchor in turn, as `pairs` have them; wire -1 shows the length itself."""
    wire, point = np.array([pairs[row % len(pairs)] for row in range(count)]).T
    q = campaign.asked(count)
    away = np.linalg.norm(campaign.truth.points(q) - ANCHORS[point], axis=1)
    shown = away + np.append(zeros, 0.0)[wire] + campaign.rng.normal(0.0, sigma, count)
    return TouchRows(q, point, shown, np.full((count, 1), sigma), 0, wire)


def task_of(campaign, rows, **given):
    return Task(nominal_of(campaign.nominal), rows, ("P", "Q"), datums=WIRES, **given)


def error_of_zeros(found, zeros, wires):
    """Errors (K,), mm, and their covariance (K, K)."""
    at = found.state.datums_at + np.array(wires)
    return found.state.datums[wires] - zeros[wires], found.covariance[np.ix_(at, at)]


@pytest.mark.long
@pytest.mark.parametrize("pairs", [TO_OWN_ANCHOR, TO_BOTH_ANCHORS, BESIDE_AN_ABSOLUTE_ONE])
def test_zeros_are_found_with_the_robot_as_well_as_is_said(pairs):
    wires, squares, shapes = sorted({wire for wire, _ in pairs if wire >= 0}), [], []
    for seed in range(SEEDS):
        campaign, zeros = at_home(seed)
        done = identify(task_of(campaign, lengths(campaign, zeros, 48, pairs)))
        error, covariance = error_of_zeros(done.identified, zeros, wires)
        squares.append(error @ np.linalg.solve(covariance, error) / len(wires))
        shapes.append(shape_error(done.identified, campaign.truth, campaign.asked()))
        assert done.identified.converged
        assert not done.outliers
        assert np.sqrt(np.diag(covariance)).max() < 0.5
    spread = np.sqrt(2.0 / (SEEDS * len(wires)))
    assert 1.0 - 2.0 * spread < np.mean(squares) < 1.0 + 2.0 * spread
    found, said = np.array(shapes).T
    assert 0.8 < np.sqrt(np.mean(found**2) / np.mean(said**2)) < 1.2


def test_a_zero_of_half_a_metre_costs_the_robot_little_and_taken_for_none_everything():
    campaign, zeros = at_home(1)
    rows, asked = lengths(campaign, zeros, 60, TO_OWN_ANCHOR), campaign.asked()
    true = replace(rows, reach=rows.reach - zeros[rows.datum], datum=np.full(60, NOT_KNOWN))
    believed = replace(rows, datum=np.full(60, NOT_KNOWN))
    unknown, absolute, wrong = (
        shape_error(identify(task_of(campaign, each)).identified, campaign.truth, asked)[0]
        for each in (rows, true, believed)
    )
    assert unknown < 1.5 * absolute
    assert wrong > 10.0 * unknown


@pytest.mark.parametrize(("wild_rows", "least", "most"), [(3, 4.0, 80.0), (12, 50.0, 300.0)])
@pytest.mark.parametrize("seed", range(3))
def test_wild_lengths_are_named_and_do_not_move_the_zero(seed, wild_rows, least, most):
    campaign, zeros = at_home(seed)
    rows = lengths(campaign, zeros, 60, TO_OWN_ANCHOR)
    outlying = campaign.rng.permutation(60)[:wild_rows]
    shown = rows.reach.copy()
    shown[outlying] += campaign.rng.uniform(least, most, wild_rows)
    done = identify(task_of(campaign, replace(rows, reach=shown)))
    assert set(done.outliers) == set(outlying.tolist())
    error, covariance = error_of_zeros(done.identified, zeros, [0, 1])
    assert error @ np.linalg.solve(covariance, error) < 15.0


@pytest.mark.parametrize("pairs", [TO_OWN_ANCHOR, BESIDE_AN_ABSOLUTE_ONE])
def test_zeros_and_anchors_start_near_from_the_nominal_robot_alone(pairs):
    for seed in range(SEEDS):
        campaign, zeros = at_home(seed)
        task = task_of(campaign, lengths(campaign, zeros, 40, pairs))
        start = task.start(task.rows)
        assert np.abs(start.datums - zeros).max() < 60.0
        assert np.linalg.norm(start.points - ANCHORS, axis=1).max() < 60.0


def test_two_lengths_of_one_wire_start_at_the_point_that_others_know():
    """Where a point is known without the wire, what the wire shows more than the distance is its zero."""
    campaign, zeros = at_home(2)
    absolute, few = (lengths(campaign, zeros, count, [pair]) for count, pair in ((30, (NOT_KNOWN, 0)), (2, (0, 0))))
    task = task_of(campaign, [absolute, few])
    assert abs(task.start(task.rows).datums[0] - zeros[0]) < 10.0


def test_a_wire_that_the_fit_never_saw_is_settled_on_the_rows_that_judge():
    campaign, zeros = at_home(3)
    rows = lengths(campaign, zeros, 96, TO_OWN_ANCHOR)
    for label in (rows.datum == 1, rows.point == 0):  # its rows, then those of the other one
        found = fit(task_of(campaign, rows), Split.by_column(label))
        assert found.test.rms < 0.3
        assert found.test.rms < 1.5 * found.predicted_test_rms
        assert found.nominal.rms > 5.0 * found.test.rms
        assert found.coverage_95 > 0.85


def test_folds_judge_lengths_with_a_zero_as_any_others():
    campaign, zeros = at_home(4)
    found = fit(task_of(campaign, lengths(campaign, zeros, 80, BESIDE_AN_ABSOLUTE_ONE)), Split.folds(80, 5, 0))
    assert found.verdict == "better"
    assert found.coverage_95 > 0.85


def test_a_wire_goes_into_one_fit_with_positions_and_sockets_of_two_sessions():
    campaign, zeros = at_home(5)
    places = np.array([[800.0, 300.0, 500.0]])
    positions = campaign.positions(20, 0.03)
    moved = pose_from_xyz_abc([300.0, -200.0, 100.0], [40.0, 3.0, -2.0])
    elsewhere = replace(campaign, truth=replace(campaign.truth, base=moved)).positions(20, 0.03, session=1)
    sockets, wire = campaign.sockets(15, places, 0.03, first=2), lengths(campaign, zeros, 30, TO_BOTH_ANCHORS)
    task = Task(
        nominal_of(campaign.nominal),
        [positions, sockets, wire, elsewhere],
        ("P", "Q", "socket"),
        sessions=(Session("a"), Session("b", frozenset({"base"}))),
        datums=("W1",),
    )
    found = identify(task).identified
    error, covariance = error_of_zeros(found, zeros, [0])
    assert abs(error[0]) < 4.0 * np.sqrt(covariance[0, 0])
    assert np.sqrt(covariance[0, 0]) < 0.1
    assert np.linalg.norm(found.state.points[:2] - ANCHORS, axis=1).max() < 0.5


def test_after_a_crash_the_lost_zeros_of_joints_are_found_with_a_wire_of_unknown_zero():
    campaign, zeros = at_home(6)
    before = identify(task_of(campaign, lengths(campaign, zeros, 200, TO_OWN_ANCHOR))).identified
    lost = np.radians([0.0, 0.4, -0.3, 0.5, -0.2, 0.0])
    crashed = replace(campaign, truth=campaign.truth.moved([f"theta{j}" for j in range(1, 7)], lost))
    rows, robot = lengths(crashed, zeros + 70.0, 30, TO_OWN_ANCHOR), before.unknowns.robot
    task = Task(
        before.state.model, rows, ("P", "Q"), datums=WIRES,
        groups=frozenset({"zeros"}), prior=before.covariance[:robot, :robot],
    )  # fmt: skip
    found = identify(task).identified
    error, covariance = error_of_zeros(found, zeros + 70.0, [0, 1])
    assert error @ np.linalg.solve(covariance, error) < 12.0
    names = [f"theta{joint}" for joint in range(2, 6)]
    at = [found.unknowns.names.index(name) for name in names]
    change = found.state.model.deviations[at] - before.state.model.deviations[at]
    np.testing.assert_allclose(change, lost[1:5], rtol=0, atol=4.0 * np.sqrt(np.diag(found.covariance)[at]).max())


def test_a_zero_that_no_row_can_tell_is_named():
    campaign, zeros = at_home(7)
    rows = lengths(campaign, zeros, 40, [(0, 0)])
    few = lengths(campaign, zeros, 3, [(1, 1)])
    unseen = fit(task_of(campaign, [rows, few]), Split(np.arange(43), ())).observability.unseen
    assert any("zero of W2" in phrase and "centre of Q" in phrase for phrase in unseen)
    assert not any("W1" in phrase for phrase in unseen)


def test_a_wire_with_too_few_lengths_judges_nothing():
    campaign, zeros = at_home(8)
    rows = [lengths(campaign, zeros, 60, [(0, 0)]), lengths(campaign, zeros, 6, [(1, 1)])]
    found = fit(task_of(campaign, rows), Split.by_column(np.arange(66) >= 64))
    assert found.verdict == "no better"
    assert "zero W2 has 4 lengths in the fit, 5 at least" in found.verdict_reason


def test_lengths_change_with_every_unknown_as_the_jacobian_says():
    campaign, _ = at_home(9)
    chain = nominal_of(campaign.nominal).chain
    model = RobotModel(chain, (ToolDeflection(0.41, 15.0),))
    second = model.on(pose_from_xyz_abc([900.0, -300.0, 50.0], [70.0, 5.0, -8.0]), chain.tool)
    state = State.of_sessions([model, second], [frozenset({"base"})], ANCHORS, np.array([40.0, -300.0]))
    unknowns = Unknowns.of(state, ("P", "Q"), Tolerances(flat_mm=1.0), sessions=("later",), datums=WIRES)
    at = unknowns.sigma * campaign.rng.standard_normal(len(unknowns.names))
    q = campaign.asked(6)
    wire, point = np.array([0, 1, -1, 0, -1, 1]), np.array([0, 1, 0, 1, 1, 0])
    rows = TouchRows(q, point, np.full(6, 900.0), np.ones((6, 1)), 1, wire)
    columns = rows.jacobian(unknowns.state(at))
    assert unknowns.names[-2:] == ("W1_zero", "W2_zero")
    assert unknowns.groups[-2:] == ("datums", "datums")
    for index, name in enumerate(unknowns.names):
        step = np.zeros(len(at))
        step[index] = 0.01 * unknowns.sigma[index]
        ahead, behind = (rows.residual(unknowns.state(at + side * step)) for side in (1.0, -1.0))
        numeric = (ahead - behind) / (2.0 * step[index])
        close = 1e-6 * np.abs(numeric).max() + 1e-11 / step[index]
        np.testing.assert_allclose(columns[..., index], numeric, rtol=0, atol=close, err_msg=name)


def test_rows_without_a_zero_are_what_they_were():
    campaign, zeros = at_home(10)
    rows = lengths(campaign, zeros, 12, [(NOT_KNOWN, 0)])
    plain = TouchRows(rows.q, rows.point, rows.reach, rows.sigma)
    assert plain.datum.tolist() == [NOT_KNOWN] * 12
    state = State.alone(nominal_of(campaign.nominal), ANCHORS)
    np.testing.assert_array_equal(plain.residual(state), rows.residual(state))
    np.testing.assert_array_equal(plain.jacobian(state), rows.jacobian(state))
    assert isinstance(plain.pick([1, 2]), TouchRows)
    assert not isinstance(plain, PositionRows | SocketRows)
