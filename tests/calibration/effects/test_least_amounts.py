"""Amounts that cannot be less than something: held there in every session, and no surer for being held."""

from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from cellctl.calibration import Backlash, PositionRows, Postures, RobotModel, Session, Task, ToolDeflection, identify

SIGMA = 0.02
TRUE = np.array([3e-4, -3e-4, 2e-4, -2e-4, 3e-4, -3e-4])


@dataclass(frozen=True)
class Leading:
    """Backlash, said never to be negative."""

    of: Backlash = field(default_factory=lambda: Backlash(6))

    def __getattr__(self, name):
        return getattr(self.of, name)

    @property
    def least(self):
        return np.zeros(6)


@pytest.fixture
def task(six_joints):
    """Two days of positions of a robot whose joints 2, 4 and 6 lag."""
    rng = np.random.default_rng(4)
    model = RobotModel(six_joints.chain(), (Backlash(6),))
    true = replace(model, amounts=TRUE)

    def day(number):
        at = Postures(rng.uniform(-1.5, 1.5, (60, 6)), approach=rng.choice([-1.0, 1.0], (60, 6)))
        return PositionRows(at, true.tcp(at) + rng.normal(0.0, SIGMA, (60, 3)), np.full((60, 3), SIGMA), number)

    return Task(model, [day(0), day(1)], sessions=(Session(), Session("later", frozenset({"base"}))))


def amounts_of(found):
    unknowns = found.identified.unknowns
    mine = [unknowns.names.index(f"backlash{joint}") for joint in range(1, 7)]
    values = [model.deviations[mine] for model in found.identified.state.models]
    return values, np.sqrt(np.diag(found.identified.covariance)[mine])


def test_what_falls_below_an_effects_least_is_held_there_in_all_sessions_and_is_no_surer(task):
    free, sigma = amounts_of(identify(task))
    held, same = amounts_of(identify(task.with_effects((Leading(),))))
    assert (free[0][1::2] < -1e-4).all()
    for values in held:
        assert_array_equal(values[1::2], 0.0)
        assert (values[::2] > 0.0).all()
    assert_allclose(same, sigma, rtol=0.5)
    assert (same > 0.0).all()


def test_a_tool_bends_one_way_only_and_joints_lag_or_lead():
    assert_array_equal(ToolDeflection(0.4, 15.0).least, [0.0])
    assert_array_equal(Backlash(2).least, [-np.inf, -np.inf])
