"""What the estimator relies on in any effect."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from cellctl.calibration.effects import (
    EFFECTS,
    Backlash,
    Discrepancy,
    Effect,
    Harmonics,
    JointCompliance,
    JointField,
    JointScale,
    MotorTorsion,
    OwnTurns,
    Straightness,
    ThermalExpansion,
    ToolDeflection,
)
from cellctl.calibration.model.postures import Postures
from cellctl.kinematics import pose_from_xyz_abc
from tests.helpers.arms import names_of

SIZES = (0.1, 0.2, 0.05)
MAKERS = {
    "scale": lambda chain: JointScale((1,)),
    "straightness": lambda chain: Straightness((1,), (-3.0,), (3.0,)),
    "deflection": lambda chain: ToolDeflection(0.41, 15.0),
    "compliance": lambda chain: JointCompliance.of(chain, load_known=True),
    "motor": lambda chain: MotorTorsion(chain.n),
    "harmonics": lambda chain: Harmonics(chain.n),
    "backlash": lambda chain: Backlash(chain.n),
    "growth": lambda chain: ThermalExpansion.of(chain),
    "field": lambda chain: JointField(
        np.linspace(-1.0, 1.0, 4)[:, None] + np.zeros(chain.n), np.linspace(1.0, 2.0, 3 * chain.n).reshape(3, -1), SIZES
    ),
    "discrepancy": lambda chain: Discrepancy(np.linspace(-1.0, 1.0, 4)[:, None] + np.zeros(chain.n)),
}


@pytest.fixture(params=list(MAKERS))
def effect(request, arm) -> Effect:
    made: Effect = MAKERS[request.param](arm.chain())
    assert made.group == request.param
    return made


@pytest.fixture
def at(arm, rng):
    sides, loads = rng.choice([-1.0, 1.0], (9, arm.n)), rng.uniform(0, 5, 9)
    currents = rng.normal(size=(9, arm.n))
    return Postures(rng.uniform(-3, 3, (9, arm.n)), sides, rng.normal(size=9), loads, currents=currents)


def parts(effect, arm, at):
    turned, shifted = effect.turns(arm.chain(), at), effect.shifts(arm.chain(), at)
    if isinstance(turned, OwnTurns):
        turned = turned.columns(np.broadcast_to(np.eye(arm.n), (len(at), arm.n, arm.n)))
    return [part for part in (turned, shifted) if part is not None]


def test_no_effect_is_left_out_here():
    assert set(MAKERS) == {kind.group for kind in EFFECTS}


def test_every_amount_has_a_name_a_unit_and_an_expected_size(effect):
    assert len(effect.parameters) == effect.sigma.size > 0
    assert all(each.unit.name and each.label for each in effect.parameters)
    assert len(set(names_of(effect))) == len(effect.parameters)
    assert np.all((effect.sigma > 0) & np.isfinite(effect.sigma))


def test_every_amount_moves_the_tool(effect, arm, at):
    (moved,) = parts(effect, arm, at)
    assert moved.shape == (9, arm.n if effect.shifts(arm.chain(), at) is None else 3, len(effect.parameters))
    assert np.all(np.abs(moved).max(axis=(0, 1)) > 0)


def test_a_row_moves_the_same_alone_as_among_others(effect, arm, at):
    for whole, some in zip(parts(effect, arm, at), parts(effect, arm, at.pick([4, 2])), strict=True):
        assert_allclose(some, whole[[4, 2]], rtol=0, atol=1e-9)


def test_no_row_at_all_is_no_error(effect, arm, at):
    for none in parts(effect, arm, at.pick(slice(0, 0))):
        assert none.shape[0] == 0


def test_where_a_robot_stands_does_not_change_what_is_modelled(effect, arm):
    elsewhere = arm.chain().with_base(pose_from_xyz_abc([900, -300, 70], [20, 30, -40]))
    assert MAKERS[effect.group](elsewhere).parameters == effect.parameters


def test_two_effects_of_a_robot_never_share_a_name(arm):
    names = [name for make in MAKERS.values() for name in names_of(make(arm.chain()))]
    assert len(set(names)) == len(names)
    assert not set(names) & set(arm.chain().parameters)


def test_effects_are_values_that_can_be_compared_and_hashed(arm):
    for group in MAKERS.keys() - {"discrepancy", "field"}:  # their postures are an array
        assert len({MAKERS[group](arm.chain()), MAKERS[group](arm.chain())}) == 1
