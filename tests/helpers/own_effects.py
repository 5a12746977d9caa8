"""Errors of a real robot's joints that no table of links has, written for tests: gravity, encoders, and all the rest.

`JointErrors` says how far joints are from where the controller reads them; `own_arm` adds it to its angles.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

CARRYING = (1, 2, 4)
"""Joints (from 0) that carry weight: shoulder, elbow, and the wrist's bend."""

MASSES = np.array([0.0, 30.0, 25.0, 10.0, 5.0, 4.0])
"""kg, each at the end of its link; only how the torque is shared matters, its size is `yielding`."""

SAG_RAD = (1e-4, 4e-4)
ENCODER_RAD = (1e-4, 3e-4)
SMOOTH_RAD = (0.5e-4, 1.5e-4)
SMOOTH_OVER_RAD = 1.5
"""How far joints move until the smooth error has forgotten what it was."""

WAVES = 40


@dataclass(frozen=True, eq=False)
class JointErrors:
    """Of n joints. yielding (n,): sag under the greatest torque, rad. encoder (2, n), phase (2, n): amplitude, rad, and
    phase of what returns once and twice a turn. smooth (n,): 1 σ, rad, of an error that depends on all joints; waves
    (W, n), 1/rad, and shares (n, W, 2): the cosines and sines that it is the sum of.
    """

    yielding: Floats
    encoder: Floats
    phase: Floats
    smooth: Floats
    waves: Floats
    shares: Floats

    @classmethod
    def drawn(cls, seed: int, n: int = 6) -> JointErrors:
        """As large as in an industrial robot; each size even in its range."""
        rng = np.random.default_rng([seed, 17])
        yielding = np.zeros(n)
        yielding[list(CARRYING)] = rng.uniform(*SAG_RAD, len(CARRYING))
        return cls(
            yielding=yielding,
            encoder=rng.uniform(*ENCODER_RAD, (2, n)),
            phase=rng.uniform(0.0, 2.0 * np.pi, (2, n)),
            smooth=np.full(n, rng.uniform(*SMOOTH_RAD)),
            waves=rng.normal(0.0, 1.0 / SMOOTH_OVER_RAD, (WAVES, n)),
            shares=rng.normal(0.0, 1.0 / np.sqrt(WAVES), (n, WAVES, 2)),
        )

    def at(self, q: Floats, links: Callable[[Floats], Floats]) -> Floats:
        """By how much (N, n), rad, joints are beyond q (N, n); `links`: poses (N, n + 1, 4, 4), mm, of the base and
        behind each joint, z upwards.
        """
        turn = q @ self.waves.T
        smooth = self.smooth * (np.cos(turn) @ self.shares[..., 0].T + np.sin(turn) @ self.shares[..., 1].T)
        encoder = sum(self.encoder[k] * np.sin((k + 1) * q + self.phase[k]) for k in range(2))
        return np.asarray(smooth + encoder + self._sag(links(q)))

    def _sag(self, poses: Floats) -> Floats:
        """Torque of gravity about each joint, as a share of the greatest that its links stretched out would give."""
        ends, result = poses[:, 1:, :3, 3], np.zeros((len(poses), len(self.yielding)))
        for joint in np.flatnonzero(self.yielding):
            axis, origin = poses[:, joint, :3, 2], poses[:, joint, :3, 3]
            arms, weights = ends[:, joint:] - origin[:, None], MASSES[joint:]
            torque = np.cross(arms, [0.0, 0.0, -1.0]) * weights[:, None]
            most = float(np.sum(np.linalg.norm(arms, axis=2).max(axis=0) * weights))
            result[:, joint] = self.yielding[joint] * np.sum(torque.sum(axis=1) * axis, axis=1) / max(most, 1e-9)
        return result
