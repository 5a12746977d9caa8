"""Weights on springs, by statics written here (conftest), against the regressors that know no mass."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from cellctl.calibration.effects import JointCompliance
from cellctl.calibration.model.postures import Postures
from cellctl.kinematics import Link, SerialChain
from tests.helpers.arms import names_of


def amounts(effect, **values):
    assert set(values) <= set(names_of(effect))
    return np.array([values.get(name, 0.0) for name in names_of(effect)])


def test_the_hand_built_arm_and_the_chain_are_the_same_robot(arm, rng):
    q = rng.uniform(-np.pi, np.pi, (5, arm.n))
    chain = arm.chain()
    assert_allclose(chain.forward(q)[:, :3, 3], arm.moved(q, arm.n - 1, arm.tip), atol=1e-9)
    assert_allclose(chain.forward_flange(q)[:, :3, 3], arm.moved(q, arm.n - 1, arm.flange[:3, 3]), atol=1e-9)


def test_amounts_say_exactly_how_any_weights_on_any_springs_sag(arm, rng):
    chain, q = arm.chain(), rng.uniform(-np.pi, np.pi, (300, arm.n))
    turned = arm.moments(q, arm.links(rng)) / rng.uniform(1e3, 1e5, arm.n)
    phi = JointCompliance.of(chain).turns(chain, Postures(q))
    fit, held_out = np.s_[:200], np.s_[200:]
    found = np.linalg.lstsq(phi[fit].reshape(-1, phi.shape[-1]), turned[fit].ravel(), rcond=None)[0]
    assert np.abs(turned).max() > 1e-4
    assert_allclose(phi[held_out] @ found, turned[held_out], atol=1e-12 * np.abs(turned).max())


def test_no_amount_can_be_made_of_the_others(arm, rng):
    chain = arm.chain()
    phi = JointCompliance.of(chain).turns(chain, Postures(rng.uniform(-np.pi, np.pi, (300, arm.n))))
    singular = np.linalg.svd(phi.reshape(-1, phi.shape[-1]), compute_uv=False)
    assert singular[-1] > 0.05 * singular[0]


def test_a_level_arm_sinks_by_its_moment_over_its_stiffness():
    tipped = SerialChain.from_links("dh-craig", [Link(alpha=-np.pi / 2)], None, np.eye(4))
    effect = JointCompliance.of(tipped)
    moment, stiffness = 2.0 * 9.80665 * 0.5, 1e4
    turns = effect.turns(tipped, Postures(np.array([[0.0], [np.pi / 3], [np.pi / 2]])))
    turned = (turns @ amounts(effect, compliance1_1x=moment / stiffness))[:, 0]
    assert_allclose(turned, moment / stiffness * np.array([1.0, 0.5, 0.0]), atol=1e-15)
    level = tipped.forward([[0.0], [turned[0]]])[:, :3, :3] @ [500.0, 0.0, 0.0]
    assert level[1, 2] - level[0, 2] == pytest.approx(-500.0 * moment / stiffness, rel=1e-6)


def test_the_tool_of_a_robot_on_springs_is_where_equilibrium_puts_it_but_for_the_square_of_the_sag(six_joints, rng):
    arm, chain, q = six_joints, six_joints.chain(), rng.uniform(-np.pi, np.pi, (40, 6))
    weights, effect = arm.links(rng), JointCompliance.of(six_joints.chain())
    phi = effect.turns(chain, Postures(q))

    def miss(stiffness):
        rested = q
        for _ in range(30):
            rested = q + arm.moments(rested, weights) / stiffness
        sag = arm.moments(q, weights) / stiffness
        found = np.linalg.lstsq(phi.reshape(-1, phi.shape[-1]), sag.ravel(), rcond=None)[0]
        moved = chain.forward(q + phi @ found)[:, :3, 3] - arm.moved(rested, 5, arm.tip)
        return np.linalg.norm(moved, axis=1).max()

    assert miss(2e5) < 0.02
    assert miss(2e6) == pytest.approx(miss(2e5) / 100.0, rel=0.05)


def test_a_known_payload_turns_each_joint_by_its_moment_over_the_stiffness(arm, rng):
    chain, q = arm.chain(), rng.uniform(-np.pi, np.pi, (20, arm.n))
    payload, stiffness = rng.uniform(0, 10, 20), rng.uniform(1e3, 1e5, arm.n)
    effect = JointCompliance.of(chain, load_known=True)
    expected = arm.moments(q, [(arm.n - 1, arm.tip, payload)]) / stiffness
    per_nm = {name: 1.0 / stiffness[int(name[-1]) - 1] for name in names_of(effect) if "load" in name}
    turned = effect.turns(chain, Postures(q, payload=payload)) @ amounts(effect, **per_nm)
    assert_allclose(turned, expected, atol=1e-15)


def test_rows_that_do_not_say_their_payload_carry_none(six_joints):
    chain = six_joints.chain()
    effect = JointCompliance.of(chain, load_known=True)
    loads = [name.startswith("compliance_load") for name in names_of(effect)]
    assert sum(loads) == 5
    assert not effect.turns(chain, Postures(np.ones((3, 6))))[..., loads].any()


def test_a_joint_that_never_leans_has_no_amounts():
    scara = SerialChain.from_links("mdh-hayati", [Link(a=300.0), Link(a=250.0, alpha=np.pi), Link(d=100.0)])
    assert JointCompliance.of(scara, load_known=True).parameters == ()
    assert JointCompliance.of(scara).turns(scara, Postures(np.ones((4, 3)))).shape == (4, 3, 0)


def test_an_upright_first_joint_has_none_and_all_others_have_two_for_each_link_they_carry(six_joints):
    names = names_of(JointCompliance.of(six_joints.chain()))
    assert len(names) == 2 * (5 + 4 + 3 + 2 + 1)
    assert not any(name.startswith("compliance1_") for name in names)
    assert names[:3] == ("compliance2_2x", "compliance2_2y", "compliance2_3x")
    assert names[-1] == "compliance6_6y"


def test_a_joint_that_is_upright_only_at_some_postures_keeps_its_amounts():
    wrist_over_shoulder = SerialChain.from_links("dh-craig", [Link(), Link(alpha=-np.pi / 2), Link(alpha=np.pi / 2)])
    names = names_of(JointCompliance.of(wrist_over_shoulder))
    assert "compliance3_3x" in names
    assert "compliance1_1x" not in names


def test_links_further_out_are_expected_to_weigh_less(six_joints):
    effect = JointCompliance.of(six_joints.chain())
    expected = dict(zip(names_of(effect), effect.sigma, strict=True))
    assert expected["compliance2_2x"] == expected["compliance5_5y"] > expected["compliance2_3x"]
    assert expected["compliance2_6y"] > 0.0


def test_a_first_joint_that_is_upright_but_for_rounding_has_no_amounts():
    rounded = SerialChain.from_links("dh-craig", [Link(alpha=3e-7), Link(alpha=1.5707963, a=100.0)])
    names = names_of(JointCompliance.of(rounded))
    assert names == ("compliance2_2x", "compliance2_2y")
