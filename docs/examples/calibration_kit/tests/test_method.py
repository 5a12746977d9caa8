"""The method against the closed form of a robot whose joints stand off by known angles."""

import numpy as np
import pytest
from calibration_kit.method import SHARE, damped_pass

import cellctl
from cellctl.compensation import METHODS, Pass


class Turned:
    """The nominal robot, with joint zeros that are off by `zeros` (n,), rad."""

    def __init__(self, chain, zeros):
        self.chain, self.zeros = chain, zeros

    def pose(self, q):
        return self.chain.forward(q + self.zeros)

    def jacobian(self, q):
        return self.chain.tool_jacobian(q + self.zeros)


def test_a_pass_leaves_a_tenth():
    chain = cellctl.robot("kr5_r1400").file.chain()
    q, zeros = np.array([[0.1, -1.2, 1.5, 0.2, 0.8, 0.3]]), np.full(6, 1e-4)
    targets = chain.forward(q)
    now = damped_pass(chain, Turned(chain, zeros), targets, Pass(q, targets, np.ones(1, bool)))
    assert now.q == pytest.approx(q - SHARE * zeros, abs=1e-7)


def test_it_is_found_by_its_name():
    assert METHODS["damped"].correction is damped_pass
