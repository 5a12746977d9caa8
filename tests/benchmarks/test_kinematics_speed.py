"""Forward kinematics, Jacobian and inverse beside the textbook's batch of 4×4 products, in turn, in CPU seconds.

CPU seconds of all threads: a rate per CPU second is one core's, whatever else the machine does.
"""

from __future__ import annotations

import time

import numpy as np
import pytest

from cellctl.kinematics import Link, SerialChain, inverse
from tests.benchmarks.side_by_side import in_turn
from tests.benchmarks.textbook import UR10, forward, forward_and_jacobian

BLOCK, BLOCKS = 1024, 40
WARM_RAD = 0.02
CLOSED_MM = 1e-9
ROUNDING_MM = 1e-11
"""What the textbook's own products may be off by, of a metre."""


@pytest.fixture(scope="module")
def chain():
    """The UR10 of the textbook as one of ours."""
    return SerialChain.from_links("dh-craig", [Link(theta=t, d=d, a=a, alpha=alpha) for alpha, a, t, d in UR10])


@pytest.fixture(scope="module")
def postures():
    """Postures with elbow and wrist bent by 20° or more and the wrist away from axis 1: none is near a singular one."""
    rng = np.random.default_rng(3)
    q = rng.uniform(-np.pi, np.pi, (4 * BLOCK * BLOCKS, 6))
    _, jacobian = forward_and_jacobian(UR10, q)
    jacobian[:, :3] /= np.abs(UR10[:, [1, 3]]).sum()
    return q[np.linalg.cond(jacobian) < 50.0][: BLOCK * BLOCKS]


def cpu_seconds_a_pose(work, poses):
    began = time.process_time()
    work()
    return (time.process_time() - began) / poses


def blocks(q):
    return np.split(q, range(BLOCK, len(q), BLOCK))


def rate(seconds):
    return f"{1e-3 / seconds:.0f} k poses/s"


@pytest.mark.long
def test_forward_kinematics_with_jacobian_is_faster_than_the_textbook(chain, postures, tell):
    parts = blocks(postures)
    pose, jacobian = chain.forward_and_jacobian(parts[0])
    expected = forward_and_jacobian(UR10, parts[0])
    np.testing.assert_allclose(pose, expected[0], rtol=0, atol=1e-9)
    np.testing.assert_allclose(jacobian, expected[1], rtol=0, atol=1e-9)
    ours, theirs = in_turn(
        lambda: cpu_seconds_a_pose(lambda: [chain.forward_and_jacobian(part) for part in parts], len(postures)),
        lambda: cpu_seconds_a_pose(lambda: [forward_and_jacobian(UR10, part) for part in parts], len(postures)),
        rounds=7,
    )
    beside = f"textbook {rate(theirs)}"
    tell("forward + Jacobian, blocks of 1024", rate(ours), beside, f"{theirs / ours:.1f} ×", "≥ 1 M poses/s")
    assert theirs / ours >= 1.2


@pytest.mark.long
def test_inverse_from_a_warm_start_costs_a_few_dozen_textbook_evaluations_and_closes(chain, postures, tell):
    goals = forward(UR10, postures)
    start = postures + np.random.default_rng(4).uniform(-WARM_RAD, WARM_RAD, postures.shape)
    found = inverse(chain, goals, start, tolerance_mm=CLOSED_MM)
    away = forward(UR10, found.q)[:, :3, 3] - goals[:, :3, 3]
    assert found.converged.all()
    assert np.linalg.norm(away, axis=1).max() <= CLOSED_MM + ROUNDING_MM
    ours, theirs = in_turn(
        lambda: cpu_seconds_a_pose(lambda: inverse(chain, goals, start, tolerance_mm=CLOSED_MM), len(goals)),
        lambda: cpu_seconds_a_pose(lambda: [forward_and_jacobian(UR10, q) for q in blocks(postures)], len(goals)),
        rounds=3,
    )
    beside = f"textbook forward + Jacobian {rate(theirs)}"
    tell("inverse to 1e-9 mm from 20 mrad off", rate(ours), beside, f"1/{ours / theirs:.1f}", "≥ 20 k poses/s")
    assert ours / theirs <= 20.0
