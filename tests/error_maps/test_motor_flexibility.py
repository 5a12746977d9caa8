"""Flexibility from motor currents, and the network that learns it: against a KR5 whose joints lag by known amounts."""

from dataclasses import dataclass

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from cellctl.error_maps.motor_flexibility import FlexibilityNetwork, MotorFlexibility, tcp_errors
from cellctl.error_maps.perceptron import Perceptron
from cellctl.error_maps.samples import UnusableSamples
from cellctl.formats import RobotFile
from tests.helpers.arms import KR5_FILE

TRUE = np.array([1.2e-4, 2.5e-4, 1.8e-4, 0.9e-4, 1.5e-4, 0.6e-4])
SIGMA_MM = 0.02
CHAIN = RobotFile.load(KR5_FILE).chain()
MIDDLE = np.deg2rad([0.0, -70.0, 80.0, 0.0, 60.0, 0.0])


@dataclass(frozen=True)
class Rows:
    q: np.ndarray
    currents: np.ndarray
    left: np.ndarray
    true: np.ndarray

    def pick(self, which):
        return Rows(self.q[which], self.currents[which], self.left[which], self.true[which])


def holding(q):
    """Currents (N, 6), A, that hold an arm of invented weights at joints `q`."""
    a2, a3, a5 = q[:, 1], q[:, 1] + q[:, 2], q[:, 1] + q[:, 2] + q[:, 4] * np.cos(q[:, 3])
    still = 0.0 * a2
    wrist = 0.5 * np.cos(a5)
    return np.stack([still, 3 * np.cos(a2) + 1.5 * np.cos(a3), 2 * np.cos(a3), 0.3 * wrist, wrist, still], axis=1)


def rows(count, seed, reach=0.6):
    """Random postures; every joint lags behind its motor by TRUE times weight and friction of ± 0.35 A."""
    rng = np.random.default_rng(seed)
    q = MIDDLE + rng.uniform(-reach, reach, (count, 6))
    currents = holding(q) + 0.35 * rng.choice([-1.0, 1.0], (count, 6))
    true = CHAIN.forward(q - TRUE * currents)[:, :3, 3] - CHAIN.forward(q)[:, :3, 3]
    return Rows(q, currents, true + rng.normal(0.0, SIGMA_MM, (count, 3)), true)


def identified(data):
    return MotorFlexibility.identified(CHAIN, data.q, data.currents, data.left, sigma_mm=SIGMA_MM)


def test_flexibility_is_found_within_its_sigma():
    scores = [(found.amounts - TRUE) / found.sigma for found in (identified(rows(80, seed)) for seed in range(20))]
    assert 0.8 < np.sqrt(np.mean(np.square(scores))) < 1.2  # 120 numbers: 1 ± 0.065


def test_flexibility_predicts_the_errors_at_measured_currents():
    found, new = identified(rows(80, 1)), rows(200, 2)
    left = np.linalg.norm(found.errors(new.q, new.currents) - new.true, axis=1)
    assert np.linalg.norm(new.true, axis=1).mean() > 0.4
    assert left.mean() < 0.02


def test_joint_errors_move_the_tcp_along_the_jacobian():
    data = rows(30, 3)
    turns = np.full((30, 6), 1e-6)
    moved = CHAIN.forward(data.q + turns)[:, :3, 3] - CHAIN.forward(data.q)[:, :3, 3]
    assert_allclose(tcp_errors(CHAIN, data.q, turns), moved, atol=1e-8)


def test_a_joint_that_never_moves_with_a_current_that_never_changes_keeps_a_plain_sigma():
    data = rows(60, 4)
    q, currents = data.q.copy(), data.currents.copy()
    q[:, 5], currents[:, 5] = 0.3, 0.0
    found = MotorFlexibility.identified(CHAIN, q, currents, data.left, sigma_mm=SIGMA_MM)
    assert found.amounts[5] == 0.0
    assert found.sigma[5] == pytest.approx(2e-4)
    assert np.isfinite(found.amounts).all()


def test_rows_without_currents_are_refused_by_number():
    data = rows(20, 5)
    data.currents[[3, 7], 2] = np.nan
    with pytest.raises(UnusableSamples, match=r"no motor currents in rows 4, 8: measure them, or leave these rows out"):
        identified(data)
    with pytest.raises(UnusableSamples, match="rows 4, 8"):
        identified(rows(20, 6)).errors(data.q, data.currents)


def test_ten_points_keep_flexibility_within_the_prior_and_repeats_of_them_add_little():
    few = rows(10, 7)
    twice = few.pick(np.repeat(np.arange(10), 2))
    for data in (few, twice):
        assert np.all(np.abs(identified(data).amounts) < 6e-4)
    assert np.all(identified(twice).sigma < identified(few).sigma)
    assert np.all(identified(twice).sigma > 0.7 * identified(few).sigma)


def test_one_far_outlier_is_refused_with_its_number():
    data = rows(60, 11)
    data.left[12] += 40.0
    with pytest.raises(UnusableSamples, match="error of sample 13"):
        identified(data)


@pytest.fixture(scope="module")
def flexibility():
    return identified(rows(80, 8))


@pytest.fixture(scope="module")
def network(flexibility):
    near = rows(500, 9, reach=0.2)
    return FlexibilityNetwork.trained(flexibility, near.q, near.currents)


def of_weight(new):
    return tcp_errors(CHAIN, new.q, -TRUE * holding(new.q))


def distance(found, true):
    return np.linalg.norm(found - true, axis=1).mean()


@pytest.mark.long
def test_the_network_predicts_from_joints_alone_what_the_weight_does(network):
    new = rows(200, 10, reach=0.15)
    assert distance(0.0, of_weight(new)) > 0.8
    assert distance(network.errors(new.q), of_weight(new)) < 0.03


def test_where_friction_winds_up_the_joints_measured_currents_predict_better_than_the_network(flexibility, network):
    """The network has no input that knows the friction, which a current at the same posture has with either sign."""
    new = rows(200, 10, reach=0.15)
    direct = distance(flexibility.errors(new.q, new.currents), new.true)
    assert direct < 0.25 * distance(network.errors(new.q), new.true)


def test_where_the_joints_turn_by_the_weight_alone_the_network_predicts_better_than_measured_currents(
    flexibility, network
):
    """It averages the friction of 500 points, which a single current contains."""
    new = rows(200, 10, reach=0.15)
    direct = distance(flexibility.errors(new.q, new.currents), of_weight(new))
    assert distance(network.errors(new.q), of_weight(new)) < 0.25 * direct


@pytest.mark.long
def test_a_network_trained_near_the_path_is_nearer_there_than_one_trained_anywhere(flexibility, network):
    new, anywhere = rows(200, 10, reach=0.15), rows(500, 9, reach=1.2)
    other = FlexibilityNetwork.trained(flexibility, anywhere.q, anywhere.currents)
    near = distance(network.errors(new.q), of_weight(new))
    assert near < 0.8 * distance(other.errors(new.q), of_weight(new))


def test_a_network_is_the_same_for_the_same_seed(flexibility):
    few, method = rows(60, 9), Perceptron(4, 0.1, seed=3)
    networks = [FlexibilityNetwork.trained(flexibility, few.q, few.currents, method=method) for _ in range(2)]
    assert_array_equal(*(network.errors(few.q) for network in networks))


def test_a_network_is_not_trained_on_rows_without_currents(flexibility):
    near = rows(100, 9)
    near.currents[4] = np.nan
    with pytest.raises(UnusableSamples, match="sample 5"):
        FlexibilityNetwork.trained(flexibility, near.q, near.currents)
