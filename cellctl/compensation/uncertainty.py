"""What of a model's uncertainty counts for targets that are given in the model's own frame."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from cellctl.calibration import RobotModel
from cellctl.kinematics import Floats

GAUGE = ("theta1", "d1")
"""Heading and height of the base: a turn about the first axis, or a slide along it, moves the robot and all that it
touched alike."""


def gauge_fixed(covariance: Floats, names: Sequence[str]) -> Floats:
    """The covariance (P, P) of parameters `names` (P,), given that θ1 and d1 are as they came out.

    No touch can see these two: whatever they are, the centres go with them. A tool's place *relative to these centres*
    is therefore as sure as if they were known, Σ_aa − Σ_ab Σ_bb⁻¹ Σ_ba, while its place in a base that somebody else
    measured is not. Zero for parameters that were held.
    """
    chosen = [index for index, name in enumerate(names) if name in GAUGE and covariance[index, index] > 0.0]
    if not chosen:
        return covariance
    columns = covariance[:, chosen]
    return np.asarray(covariance - columns @ np.linalg.solve(covariance[np.ix_(chosen, chosen)], columns.T))


def sigma_among(model: RobotModel, covariance: Floats, q: ArrayLike) -> float:
    """1 σ (3-D, RMS over the rows), mm, of tool centre points among themselves at model angles q (N, n), rad.

    What moves all of them as one body is left out: where the model's frame lies is a question to whoever gave the
    targets. N ≥ 4: three points and fewer have hardly any shape.
    """
    angles = np.asarray(q, float)
    if len(angles) < 4:
        raise ValueError(f"{len(angles)} points have no shape to speak of")
    columns = model.jacobian(angles)[:, :3].reshape(3 * len(angles), -1)
    together, _ = np.linalg.qr(_rigid_motions(model.tip(angles)))
    shape = columns - together @ (together.T @ columns)
    return float(np.sqrt(np.einsum("rp,pq,rq->", shape, covariance, shape) / len(angles)))


def _rigid_motions(points: Floats) -> Floats:
    """How points (N, 3) move under three slides and three turns about their middle (3 N, 6), per mm and per spread."""
    arms = points - points.mean(axis=0)
    arms = arms / max(float(np.abs(arms).max()), 1e-9)
    turns = [np.cross(axis, arms) for axis in np.eye(3)]
    slides = [np.broadcast_to(axis, arms.shape) for axis in np.eye(3)]
    return np.stack([motion.reshape(-1) for motion in (*slides, *turns)], axis=1)
