"""A link pushed to and fro inside its play, step by step, against half the play by approach."""

import numpy as np
from numpy.testing import assert_allclose

from cellctl.calibration.effects import Backlash
from cellctl.calibration.model.postures import Postures

PLAY = np.array([2e-4, 1e-4, 0.0, 3e-4, 5e-5, 4e-4])


def pushed(readings, play):
    """Where links rest whose motors go to `readings` one after the other: each moves when its play is used up."""
    rest, rests = readings[0].copy(), []
    for reading in readings:
        rest = np.clip(rest, reading - play / 2, reading + play / 2)
        rests.append(rest)
    return np.array(rests)


def test_where_a_joint_came_from_says_where_in_its_play_it_rests(six_joints, rng):
    readings = np.cumsum(rng.choice([-1, 1], (50, 6)) * rng.uniform(0.01, 0.1, (50, 6)), axis=0)
    rests = pushed(readings, PLAY)[1:]
    at = Postures(readings[1:], approach=np.sign(np.diff(readings, axis=0)))
    turned = Backlash(6).turns(six_joints.chain(), at) @ (-PLAY / 2)
    assert_allclose(readings[1:] + turned, rests, atol=1e-15)


def test_a_joint_of_unknown_approach_stands_midway(six_joints):
    chain, q = six_joints.chain(), np.ones((3, 6))
    some = np.array([[1, 0, -1, 0, 1, 1]] * 3, float)
    assert not Backlash(6).turns(chain, Postures(q)).any()
    assert not (Backlash(6).turns(chain, Postures(q, approach=some)) @ PLAY)[:, [1, 3]].any()
