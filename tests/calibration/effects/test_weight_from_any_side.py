"""Robots on walls, under ceilings, on slopes: weights on springs by statics written here, against the regressors."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from cellctl.calibration.effects import JointCompliance, ToolDeflection
from cellctl.calibration.model.postures import Postures
from tests.helpers.arms import names_of

WALL, CEILING, SLOPE = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.48, -0.6, -0.64)


@pytest.fixture(params=[WALL, CEILING, SLOPE], ids=["wall", "ceiling", "slope"])
def down(request):
    return request.param


def test_amounts_say_exactly_how_any_weights_on_any_springs_sag(arm, down, rng):
    hung, chain, q = replace(arm, down=down), arm.chain(), rng.uniform(-np.pi, np.pi, (300, arm.n))
    turned = hung.moments(q, hung.links(rng)) / rng.uniform(1e3, 1e5, arm.n)
    phi = JointCompliance.of(chain, down=down).turns(chain, Postures(q))
    fit, held_out = np.s_[:200], np.s_[200:]
    found = np.linalg.lstsq(phi[fit].reshape(-1, phi.shape[-1]), turned[fit].ravel(), rcond=None)[0]
    assert np.abs(turned).max() > 1e-4
    assert_allclose(phi[held_out] @ found, turned[held_out], atol=1e-12 * np.abs(turned).max())


def test_no_amount_can_be_made_of_the_others(arm, down, rng):
    chain = arm.chain()
    phi = JointCompliance.of(chain, down=down).turns(chain, Postures(rng.uniform(-np.pi, np.pi, (300, arm.n))))
    singular = np.linalg.svd(phi.reshape(-1, phi.shape[-1]), compute_uv=False)
    assert singular[-1] > 0.05 * singular[0]


def test_a_known_payload_turns_each_joint_by_its_moment_over_the_stiffness(arm, down, rng):
    hung, chain, q = replace(arm, down=down), arm.chain(), rng.uniform(-np.pi, np.pi, (20, arm.n))
    payload, stiffness = rng.uniform(0, 10, 20), rng.uniform(1e3, 1e5, arm.n)
    effect = JointCompliance.of(chain, load_known=True, down=down)
    per_nm = {f"compliance_load{joint + 1}": 1.0 / stiffness[joint] for joint in range(arm.n)}
    amounts = np.array([per_nm.get(name, 0.0) for name in names_of(effect)])
    expected = hung.moments(q, [(arm.n - 1, arm.tip, payload)]) / stiffness
    assert_allclose(effect.turns(chain, Postures(q, payload=payload)) @ amounts, expected, atol=1e-15)


def test_the_first_joint_bears_weight_on_a_wall_or_a_slope_and_none_under_a_ceiling(six_joints):
    chain = six_joints.chain()
    bearing = {down: "compliance1_6y" in names_of(JointCompliance.of(chain, down=down)) for down in (WALL, SLOPE)}
    assert bearing == {WALL: True, SLOPE: True}
    assert JointCompliance.of(chain, down=CEILING).upright == {1}
    assert len(JointCompliance.of(chain, down=WALL).parameters) == 2 * (6 + 5 + 4 + 3 + 2 + 1)


def test_a_tool_bends_to_where_weight_pulls_it_and_not_along_itself(six_joints, down, rng):
    chain, q = six_joints.chain(), rng.uniform(-np.pi, np.pi, (10, 6))
    shift = ToolDeflection(0.41, 15.0, down=down).shifts(chain, Postures(q))[..., 0]
    axes = six_joints.directed(q, 5, six_joints.flange[:3, 2])
    leaning = np.sqrt(1.0 - (axes @ down) ** 2)
    assert_allclose(np.linalg.norm(shift, axis=1), 1000.0 * 0.41**3 / 3.0 * 15.0 * leaning, rtol=1e-9)
    assert_allclose(np.sum(shift * axes, axis=1), 0.0, atol=1e-9)
    assert (shift @ down > 0.0).all()


def test_a_tool_that_lies_along_the_weight_does_not_bend(six_joints):
    chain = six_joints.chain()
    level = np.zeros((1, 6))  # stretched out along the base's x, which points down on a wall
    assert_allclose(chain.forward_flange(level)[0, :3, 2], [1, 0, 0], atol=1e-12)
    assert_allclose(ToolDeflection(0.41, 15.0, down=WALL).shifts(chain, Postures(level)), 0.0, atol=1e-12)
