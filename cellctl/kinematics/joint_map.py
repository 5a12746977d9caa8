"""Conversion between a controller's joint readings and the model's angles: a sign and an offset for each joint."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self, final

import numpy as np
from numpy.typing import ArrayLike

from cellctl.kinematics.arrays import Floats


@final
@dataclass(frozen=True)
class JointMap:
    """model angle (rad) = sign · reading (deg, as the controller shows it) + offset (deg); arrays of shape (n,)."""

    sign: Floats
    offset: Floats

    @classmethod
    def from_lists(cls, sign: ArrayLike, offset: ArrayLike) -> Self:
        """From signs (+1 or −1 each) and offsets in degrees. Raises ValueError for another sign or unequal lengths."""
        signs, offsets = np.asarray(sign, float), np.asarray(offset, float)
        if signs.shape != offsets.shape or signs.ndim != 1:
            raise ValueError(f"{signs.size} signs for {offsets.size} offsets")
        if not np.all(np.abs(signs) == 1.0):
            raise ValueError("a joint's sign is 1 or -1")
        return cls(signs, offsets)

    @property
    def n(self) -> int:
        """Number of joints."""
        return int(self.sign.size)

    def model(self, readings: ArrayLike) -> Floats:
        """Model angles (..., n), rad, of controller readings (..., n), deg."""
        return np.asarray(np.deg2rad(self.sign * np.asarray(readings, float) + self.offset))

    def readings(self, model: ArrayLike) -> Floats:
        """Controller readings (..., n), deg, of model angles (..., n), rad."""
        return np.asarray(self.sign * (np.rad2deg(np.asarray(model, float)) - self.offset))
