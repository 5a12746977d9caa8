"""How sure the identified robot's tool centre point is over its workspace: absolutely, and as a shape."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from scipy.stats import qmc

from cellctl.formats import ModelFile
from cellctl.kinematics import Floats

AROUND_MM = 200.0
"""The volume looked at: the box about the sphere centres, this much larger on every side."""

_SAMPLES, _FEWEST = 8192, 32


@final
@dataclass(frozen=True, slots=True)
class VolumeSigma:
    """1 σ of the tool centre point, 3-D, mm, over `points` poses: RMS and greatest.

    raw: in the base frame. relative: with the best rigid motion of all points together removed, so of one point
    relative to the others: what is left to do harm once the artefact, or a work-piece, has been found by touching it.
    """

    points: int
    raw_rms: float
    raw_max: float
    relative_rms: float
    relative_max: float


def volume_sigma(model: ModelFile) -> VolumeSigma | None:
    """σ over the volume about the spheres, in the joint region of the fit; None where too little of it is reached."""
    robot, q = model.robot_model(), _poses(model)
    if len(q) < _FEWEST:
        return None
    spread = robot.jacobian(q)[:, :3] @ _root(np.array(model.covariance))
    raw, relative = _lengths(spread), _lengths(without_rigid_motion(robot.tcp(q), spread))
    return VolumeSigma(len(q), _rms(raw), float(raw.max()), _rms(relative), float(relative.max()))


def without_rigid_motion(points: Floats, moves: Floats) -> Floats:
    """`moves` (N, 3, K) of `points` (N, 3), mm, each of the K less the rigid motion nearest to it (least squares)."""
    away = points - points.mean(axis=0)
    away = away / max(float(np.abs(away).max()), 1e-9)
    turns = np.stack([np.cross(axis, away) for axis in np.eye(3)], axis=-1)
    rigid = np.concatenate([np.tile(np.eye(3), (len(points), 1, 1)), turns], axis=-1).reshape(-1, 6)
    basis, weights, _ = np.linalg.svd(rigid, full_matrices=False)
    basis = basis[:, weights > 1e-9 * weights[0]]  # points on a line have no turn about it
    flat = moves.reshape(len(rigid), -1)
    return np.asarray((flat - basis @ (basis.T @ flat)).reshape(moves.shape))


def _poses(model: ModelFile) -> Floats:
    """Model angles (N, n), rad: quasi-random in the joint region of the fit, the tip in the volume."""
    lower, upper = np.array(model.joint_region.min), np.array(model.joint_region.max)
    samples = qmc.Sobol(len(lower), rng=np.random.default_rng(1)).random(_SAMPLES)
    q = model.robot.joint_map().model(lower + samples * (upper - lower))
    centres = np.array([centre.xyz for centre in model.centres]).reshape(-1, 3)
    if not len(centres):
        return np.asarray(q[:512])
    tips = model.robot_model().tcp(q)
    inside = (tips >= centres.min(axis=0) - AROUND_MM) & (tips <= centres.max(axis=0) + AROUND_MM)
    return np.asarray(q[inside.all(axis=1)])


def _root(covariance: Floats) -> Floats:
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


def _lengths(spread: Floats) -> Floats:
    return np.asarray(np.sqrt(np.sum(spread**2, axis=(1, 2))))


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))
