"""Positions measured with the tool in one or two orientations only, as many a program leaves them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from tests.helpers.own_model import Floats, ur10
from tests.helpers.simulated_setups import Draw, seen_by_tracker

DOWN = np.radians([0.0, -100.0, 110.0, -100.0, -90.0, 20.0])
"""A UR10 with its tool pointing down, in the middle of where it works."""

ROWS, ASKED = 45, 20
UPRIGHT = Rotation.identity()
TILTED = Rotation.from_euler("x", 40.0, degrees=True)


def fixed(seed: int, turns: Sequence[Rotation]) -> tuple[Draw, Floats]:
    """45 points of a UR10 within 0.6 m, its tool turned from straight down by each of `turns` in turn, as its
    controller commands it, asked at the same; and angles (20, 6) at which the tool is turned by up to 40° otherwise.
    """
    rng = np.random.default_rng([seed, 5])
    q, same = _angles(rng, ROWS, turns), _angles(rng, ASKED, turns)
    others = [Rotation.from_euler("zyx", rng.uniform(-40.0, 40.0, 3), degrees=True) for _ in range(ASKED)]
    return seen_by_tracker(rng, ur10(), q, same), _angles(rng, ASKED, others)


def _angles(rng: np.random.Generator, count: int, turns: Sequence[Rotation]) -> Floats:
    arm, q, left = ur10(), np.zeros((count, 6)), np.arange(count)
    middle = arm.poses(DOWN[None])[0]
    while left.size:  # a place that is out of reach in its orientation is drawn again
        wanted = np.tile(middle, (left.size, 1, 1))
        wanted[:, :3, 3] += rng.uniform(-300.0, 300.0, (left.size, 3))
        wanted[:, :3, :3] = np.array([turns[i % len(turns)].as_matrix() @ middle[:3, :3] for i in left.tolist()])
        q[left] = arm.held(wanted, np.tile(DOWN, (left.size, 1)))
        left = left[~np.isclose(arm.poses(q[left]), wanted, atol=1e-7).all(axis=(1, 2))]
    return q
