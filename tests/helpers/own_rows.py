"""What was measured in a simulated set-up, and how far an arm is from it in standard deviations; written for tests."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from tests.helpers.own_model import Floats, OwnArm


class OwnRows(Protocol):
    """Measurements at joint angles q (N, n)."""

    @property
    def q(self) -> Floats: ...

    def misfit(self, arm: OwnArm, centres: Floats) -> Floats:
        """(Model − measurement) / σ, in one row; centres (S, 3) of the spheres, if there are any."""
        ...


@dataclass(frozen=True, eq=False)
class OwnPositions:
    """Points xyz (N, 3), mm, with the same σ on each axis."""

    q: Floats
    xyz: Floats
    sigma_mm: float

    def misfit(self, arm: OwnArm, centres: Floats) -> Floats:
        del centres
        return ((arm.points(self.q) - self.xyz) / self.sigma_mm).ravel()


@dataclass(frozen=True, eq=False)
class OwnPoses:
    """Poses (N, 4, 4) with the same σ on each axis, mm, and about each axis, rad."""

    q: Floats
    poses: Floats
    sigma_mm: float
    sigma_rad: float

    def misfit(self, arm: OwnArm, centres: Floats) -> Floats:
        del centres
        now = arm.poses(self.q)
        turn = small_turn(now[:, :3, :3] @ np.swapaxes(self.poses[:, :3, :3], -1, -2))
        away = (now[:, :3, 3] - self.poses[:, :3, 3]) / self.sigma_mm
        return np.concatenate([away, turn / self.sigma_rad], axis=1).ravel()


@dataclass(frozen=True, eq=False)
class OwnTouches:
    """Touches: the tip is `reach` (mm) from the centre of sphere (N,). Certified distances between pairs, mm."""

    q: Floats
    sphere: NDArray[np.intp]
    reach: float
    sigma_mm: float
    spacings: Floats
    spacing_sigma_mm: float

    @staticmethod
    def pairs(spheres: int) -> NDArray[np.intp]:
        """Index pairs of all spacings."""
        return np.array(list(combinations(range(spheres), 2)), dtype=np.intp)

    def misfit(self, arm: OwnArm, centres: Floats) -> Floats:
        off = np.linalg.norm(arm.points(self.q) - centres[self.sphere], axis=1) - self.reach
        return np.concatenate([off / self.sigma_mm, (between(centres) - self.spacings) / self.spacing_sigma_mm])


def between(centres: Floats) -> Floats:
    """Distances of all pairs of centres."""
    first, second = OwnTouches.pairs(len(centres)).T
    return np.asarray(np.linalg.norm(centres[first] - centres[second], axis=1))


def small_turn(rotation: Floats) -> Floats:
    """Axis times angle (N, 3), rad, of rotations (N, 3, 3) below a right angle, through the sine."""
    skew = np.stack([rotation[:, i, j] - rotation[:, j, i] for i, j in ((2, 1), (0, 2), (1, 0))], axis=1) / 2.0
    sine = np.linalg.norm(skew, axis=1, keepdims=True)
    return np.asarray(skew * np.where(sine > 1e-9, np.arcsin(np.minimum(sine, 1.0)) / np.maximum(sine, 1e-9), 1.0))
