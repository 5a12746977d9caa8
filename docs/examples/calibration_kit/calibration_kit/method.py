"""A compensation method: each pass corrects nine tenths of what is left, at the joints."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cellctl.compensation import Method, Pass, Predictor
from cellctl.kinematics import Floats, SerialChain, pose_difference

SHARE = 0.9
"""Of the difference that a pass corrects; each pass has to leave less than half."""


def damped_pass(controller: SerialChain, robot: Predictor, targets: Floats, now: Pass) -> Pass:
    """q ← q + 0.9 J⁺ (T_d − f(q)); targets (N, 4, 4), mm; `now.q` (N, n), rad."""
    left = pose_difference(targets, robot.pose(now.q))
    step = np.einsum("nij,nj->ni", np.linalg.pinv(robot.jacobian(now.q)), left)
    return replace(now, q=now.q + SHARE * step)


METHOD = Method(damped_pass, zeros_apart=True)
