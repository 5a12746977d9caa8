"""Measured points of one set-up of an instrument, with the covariance of all of them together.

A covariance has a part of each point alone and a common part (range scale and zero, refraction, centring), which has
the same value in the beam's own directions at every point: along the beam, across it horizontally, and vertically.
Samples and points do not average the common part away.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self, final

import numpy as np
from numpy.typing import ArrayLike

from cellctl.kinematics import Floats

LEAST_MM = 1e-5
"""Smallest standard deviation of a point alone, mm: keeps every covariance invertible."""


@final
@dataclass(frozen=True, eq=False)
class Points:
    """N points. xyz (N, 3), mm, in the instrument's frame, its origin at the instrument, z its standing axis.

    covariance (N, 3, 3), mm²: all of each point's. common (N, 3, 3), mm²: the part of it that all points share.
    """

    xyz: Floats
    covariance: Floats
    common: Floats

    @classmethod
    def of(cls, xyz: ArrayLike, covariance: ArrayLike, common: ArrayLike | None = None) -> Self:
        """From arrays (N, 3), (N, 3, 3), (N, 3, 3); a covariance may be (3, 3) for all, or a σ in mm.

        Raises ValueError for other shapes, values that are not finite, or a common part that is larger than the whole.
        """
        places = np.atleast_2d(np.asarray(xyz, float))
        whole, shared = _full(covariance, len(places)), _full(0.0 if common is None else common, len(places))
        if places.shape[1:] != (3,) or not all(np.isfinite(part).all() for part in (places, whole, shared)):
            raise ValueError("points need three finite coordinates and a finite covariance each")
        alone = np.linalg.eigvalsh(whole - shared)
        if (alone < -1e-9 * np.trace(whole, axis1=1, axis2=2)[:, None] - LEAST_MM**2).any():
            raise ValueError("the common part of a point's covariance is larger than the covariance")
        return cls(places, whole, shared)

    @classmethod
    def joined(cls, parts: Sequence[Self]) -> Self:
        """Several sets of the same set-up as one."""
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in _FIELDS))

    def __len__(self) -> int:
        return len(self.xyz)

    def pick(self, which: Any) -> Points:
        """The points at an index array or mask."""
        return Points(*(getattr(self, name)[which] for name in _FIELDS))

    @property
    def alone(self) -> Floats:
        """The part (N, 3, 3) that each point has for itself."""
        return np.asarray(self.covariance - self.common + LEAST_MM**2 * np.eye(3))

    @property
    def range_sigma(self) -> Floats:
        """Standard deviation (N,), mm, of the common part along each beam: of the zero of the range (`sZero`)."""
        beams = beam_directions(self.xyz)[..., 0]
        return np.asarray(np.sqrt(np.einsum("ni,nij,nj->n", beams, self.common, beams)))

    def joint_covariance(self) -> Floats:
        """Covariance (3N, 3N), mm², of all coordinates: Σ_ij = δ_ij (C_i − K_i) + L_i L_jᵀ.

        L_i = B_i √(B_iᵀ K_i B_i), with the beam's directions B_i at point i and its common part K_i.
        """
        result = block_diagonal(self.alone)
        beams = beam_directions(self.xyz)
        shared = np.matmul(beams, _root(np.swapaxes(beams, 1, 2) @ self.common @ beams)).reshape(-1, 3)
        return np.asarray(result + shared @ shared.T)


_FIELDS = ("xyz", "covariance", "common")


def beam_directions(xyz: Floats) -> Floats:
    """Rotations (N, 3, 3) whose columns are along the beam, across it horizontally, and across it upwards."""
    along = xyz / np.maximum(np.linalg.norm(xyz, axis=-1, keepdims=True), 1e-9)
    level = np.stack([-along[:, 1], along[:, 0], np.zeros(len(xyz))], axis=-1)
    length = np.linalg.norm(level, axis=-1, keepdims=True)
    across = np.where(length > 1e-9, level / np.maximum(length, 1e-9), [0.0, 1.0, 0.0])
    along = np.where(np.linalg.norm(along, axis=-1, keepdims=True) > 0.5, along, [1.0, 0.0, 0.0])
    return np.stack([along, across, np.cross(along, across)], axis=-1)


def block_diagonal(blocks: Floats) -> Floats:
    """The (N·k, N·k) matrix with `blocks` (N, k, k) on its diagonal."""
    count, size = blocks.shape[:2]
    result = np.zeros((count, size, count, size))
    result[np.arange(count), :, np.arange(count)] = blocks
    return result.reshape(count * size, count * size)


def whitened(covariance: Floats, *arrays: Floats) -> list[Floats]:
    """L⁻¹ a for each array, with covariance (k, k) = L Lᵀ: rows of unit variance. Raises LinAlgError if singular."""
    root = np.linalg.cholesky(covariance)
    return [np.linalg.solve(root, array) for array in arrays]


def _full(covariance: ArrayLike, count: int) -> Floats:
    given = np.asarray(covariance, float)
    whole = given**2 * np.eye(3) if given.ndim == 0 else given
    if whole.shape not in ((3, 3), (count, 3, 3)):
        raise ValueError(f"a covariance of shape {given.shape} for {count} points")
    return np.array(np.broadcast_to(whole, (count, 3, 3)))


def _root(matrices: Floats) -> Floats:
    """Symmetric square roots of (N, 3, 3)."""
    values, vectors = np.linalg.eigh(matrices)
    return np.asarray((vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :]) @ np.swapaxes(vectors, 1, 2))
