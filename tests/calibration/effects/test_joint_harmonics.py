"""Encoder discs off their centre and couplings out of line, by trigonometry, against once and twice per turn."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from cellctl.calibration.effects import Harmonics
from cellctl.calibration.model.postures import Postures
from tests.helpers.arms import names_of

TURN = np.linspace(-np.pi, np.pi, 73)


def wobble(six_joints, angles, joint, **values):
    """What joint (from 1) turns by at each angle, all other joints at 0.7 rad."""
    q = np.full((angles.size, 6), 0.7)
    q[:, joint - 1] = angles
    effect = Harmonics(6)
    amounts = np.array([values.get(name.removeprefix(f"harmonic{joint}_"), 0.0) for name in names_of(effect)])
    amounts *= [name.startswith(f"harmonic{joint}_") for name in names_of(effect)]
    turned = effect.turns(six_joints.chain(), Postures(q)).total(amounts, 6)
    assert not np.delete(turned, joint - 1, axis=1).any()
    return turned[:, joint - 1]


def eccentric_disc(angles, offset, radius):
    """True angle of a joint whose disc, `offset` (x, y) from the axis, shows `angles` at a head `radius` away."""
    true = angles
    for _ in range(30):
        head = radius * np.array([np.cos(-true), np.sin(-true)])  # the head as the disc sees it go round
        shown = -np.unwrap(np.arctan2(head[1] - offset[1], head[0] - offset[0]))
        true = true - (shown - angles)
    return true


def test_a_disc_off_its_centre_is_once_per_turn(six_joints):
    radius, offset = 30.0, np.array([0.003, -0.002])
    error = eccentric_disc(TURN, offset, radius) - TURN
    at_zero = np.interp(0.0, TURN, error)
    model = wobble(six_joints, TURN, 3, s1=-offset[0] / radius, c1=-offset[1] / radius)
    assert np.abs(error - at_zero).max() > 1e-4
    assert_allclose(model, error - at_zero, atol=5e-8)


def test_a_coupling_out_of_line_is_twice_per_turn(six_joints):
    bend = 0.03  # rad between the shafts of a universal joint
    driven = np.unwrap(np.arctan2(np.sin(TURN) * np.cos(bend), np.cos(TURN)))
    error = driven - TURN
    assert np.abs(error).max() > 2e-4
    assert_allclose(wobble(six_joints, TURN, 5, s2=-(bend**2) / 4), error, atol=1e-7)


@pytest.mark.parametrize("wave", ["s1", "c1", "s2", "c2"])
def test_joint_zeros_mean_the_same_with_harmonics_as_without(six_joints, wave):
    assert wobble(six_joints, np.zeros(1), 2, **{wave: 1.0}) == pytest.approx(0.0, abs=1e-15)


def test_four_waves_and_the_joint_zero_can_be_told_apart_over_a_turn(six_joints):
    waves = [wobble(six_joints, TURN, 1, **{wave: 1.0}) for wave in ("s1", "c1", "s2", "c2")]
    assert np.linalg.cond(np.stack([np.ones(TURN.size), *waves], axis=1)) < 10.0


def test_a_single_wave_of_one_joint_can_be_named_beside_the_orders_of_all(six_joints):
    effect = Harmonics(6, orders=(1, 2), ripple=((4, 17), (1, 2)))
    assert names_of(effect)[:4] == ("harmonic1_s1", "harmonic1_c1", "harmonic1_s2", "harmonic1_c2")
    assert names_of(effect)[-2:] == ("harmonic4_s17", "harmonic4_c17")
    assert len(effect.parameters) == 26
    q = np.zeros((TURN.size, 6))
    q[:, 3] = TURN
    amounts = np.array([2e-4 * (name == "harmonic4_s17") for name in names_of(effect)])
    turned = effect.turns(six_joints.chain(), Postures(q)).total(amounts, 6)
    assert_allclose(turned[:, 3], 2e-4 * np.sin(17 * TURN), atol=1e-15)
    assert not np.delete(turned, 3, axis=1).any()


def test_every_joint_has_48_waves_and_each_octave_of_them_is_expected_to_do_one_minute_of_arc(six_joints):
    effect = Harmonics(6)
    assert effect.waves == tuple((joint, order) for joint in range(1, 7) for order in range(1, 49))
    bands = [[1, 2], [3, 4, 5], list(range(6, 12)), list(range(12, 24)), list(range(24, 49))]
    for joint, orders in [(joint, orders) for joint in range(1, 7) for orders in bands]:
        names = [f"harmonic{joint}_{part}{order}" for order in orders for part in "sc"]
        mine = [names_of(effect).index(name) for name in names]
        (band,) = {effect.bands[place] for place in mine}
        assert effect.bands.count(band) == len(mine)
        # the mean square of a wave over a turn is half its amplitude's: E Σ (s² + c²) / 2 = 2e-4²
        assert np.sqrt(np.sum(effect.sigma[mine] ** 2) / 2.0) == pytest.approx(2e-4)


def dense(turns):
    """Φ (N, 6, K)."""
    return turns.columns(np.broadcast_to(np.eye(6), (len(turns.values), 6, 6)))


def test_each_waves_turns_are_the_same_in_total_and_as_columns(six_joints, rng):
    effect, chain, at = Harmonics(6), six_joints.chain(), Postures(rng.uniform(-3.0, 3.0, (5, 6)))
    turns, amounts = effect.turns(chain, at), rng.normal(0.0, effect.sigma)
    arms = chain.tool_jacobian(at.q)
    assert_allclose(turns.total(amounts, 6), dense(turns) @ amounts, atol=1e-15)
    assert_allclose(turns.columns(arms), arms @ dense(turns), atol=1e-9)


def test_where_a_joint_was_not_measured_the_variance_of_its_fast_waves_is_the_priors_again(six_joints):
    """Measured over a quarter of a turn at every 1.5°, to 1e-6 rad: there any shape is known, elsewhere none."""
    effect, chain = Harmonics(6), six_joints.chain()
    measured, far = np.radians(np.arange(-60.0, 30.0, 1.5)), np.radians(np.arange(120.0, 200.0, 3.0))

    def lines(angles, orders):
        q = np.zeros((angles.size, 6))
        q[:, 2] = angles
        names = [f"harmonic3_{part}{order}" for order in orders for part in "sc"]
        mine = [names_of(effect).index(name) for name in names]
        return dense(effect.turns(chain, Postures(q)))[:, 2, mine] * effect.sigma[mine]

    def variances(angles, orders):
        seen, at = lines(measured, orders) / 1e-6, lines(angles, orders)
        posterior = np.linalg.inv(seen.T @ seen + np.eye(seen.shape[1]))
        return np.einsum("nk,kl,nl->n", at, posterior, at)

    for orders in (range(12, 24), range(24, 49)):
        assert variances(measured[2:-2], orders).max() < 1e-3 * 2e-4**2
        assert variances(far, orders).min() > 0.75 * 2e-4**2
