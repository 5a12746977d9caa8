"""A posture as controllers number it: joint readings by sign and offset, and status and turn of a six-axis arm.

Source: the definitions of status and turn in KUKA's programming manuals, and the same numbers in the programming manual
of TwinCAT CNC ("Status & Turn", kinematic type 45). Robots with a spherical wrist.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Self, TypeAlias, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cellctl.kinematics._chain import MM_PER_M, SerialChain
from cellctl.kinematics._frames import Bools, Floats

JointUnit: TypeAlias = Literal["°", "mm"]
"""The unit of a joint's reading, as people read it."""


@final
@dataclass(frozen=True)
class JointMap:
    """model coordinate (rad) = sign · reading (deg, as the controller shows it) + offset (deg); arrays of shape (n,).

    Of a prismatic joint the reading and the offset are mm, the model coordinate m. prismatic: which joints are; None:
    none of them.
    """

    sign: Floats
    offset: Floats
    prismatic: Bools | None = None

    @classmethod
    def from_lists(cls, sign: ArrayLike, offset: ArrayLike, prismatic: ArrayLike | None = None) -> Self:
        """From signs (+1 or −1 each), offsets (deg or mm) and which joints are prismatic; default: none.

        Raises ValueError for another sign or unequal lengths.
        """
        signs, offsets = np.asarray(sign, float), np.asarray(offset, float)
        if signs.shape != offsets.shape or signs.ndim != 1:
            raise ValueError(f"{signs.size} signs for {offsets.size} offsets")
        if not np.all(np.abs(signs) == 1.0):
            raise ValueError("a joint's sign is 1 or -1")
        slides = np.zeros(0, bool) if prismatic is None else np.asarray(prismatic, bool)
        if slides.any() and slides.shape != signs.shape:
            raise ValueError(f"{signs.size} signs for {slides.size} joints")
        return cls(signs, offsets, slides if slides.any() else None)

    @property
    def n(self) -> int:
        """Number of joints."""
        return int(self.sign.size)

    @property
    def units(self) -> tuple[JointUnit, ...]:
        """The unit of each joint's reading."""
        slides = np.zeros(self.n, bool) if self.prismatic is None else self.prismatic
        return tuple("mm" if each else "°" for each in slides)

    def model(self, readings: ArrayLike) -> Floats:
        """Model coordinates (..., n), rad or m, of controller readings (..., n), deg or mm."""
        return self.in_model_units(self.sign * np.asarray(readings, float) + self.offset)

    def readings(self, model: ArrayLike) -> Floats:
        """Controller readings (..., n), deg or mm, of model coordinates (..., n), rad or m."""
        return np.asarray(self.sign * (self.in_reading_units(model) - self.offset))

    def in_model_units(self, values: ArrayLike) -> Floats:
        """Values (..., n) in deg (mm of a prismatic joint) as rad (m)."""
        given = np.asarray(values, float)
        turned = np.asarray(np.deg2rad(given))
        return turned if self.prismatic is None else np.where(self.prismatic, given / MM_PER_M, turned)

    def in_reading_units(self, values: ArrayLike) -> Floats:
        """Values (..., n) in rad (m of a prismatic joint) as deg (mm)."""
        given = np.asarray(values, float)
        turned = np.asarray(np.rad2deg(given))
        return turned if self.prismatic is None else np.where(self.prismatic, given * MM_PER_M, turned)


Ints = NDArray[np.int64]

OVERHEAD, ELBOW, FLIPPED = 1, 2, 4
"""Bits of a status: wrist centre behind axis 1, wrist centre in front of the line from axis 2 to axis 3, A5 < 0."""


def turn_of(readings: ArrayLike) -> Ints:
    """Turn (...) of controller readings (..., n), deg: bit i is set where the reading of axis i + 1 is below 0."""
    below = np.asarray(readings, float) < 0.0
    return np.asarray(below @ (1 << np.arange(below.shape[-1], dtype=np.int64)), np.int64)


def status_of(chain: SerialChain, joints: JointMap, readings: ArrayLike) -> Ints:
    """Status (...) of controller readings (..., 6), deg: the sum of OVERHEAD, ELBOW and FLIPPED.

    Overhead: the wrist centre has a negative X in the base frame turned by A1. Elbow: turning A3 in its positive sense
    has carried the wrist centre past the line through axes 2 and 3; without an offset between axes 3 and 4 that is
    A3 ≥ 0. The wrist centre is the point of axis 4 that is nearest to axis 6. Raises ValueError for a robot that does
    not have six joints.
    """
    if chain.n != 6:
        raise ValueError(f"status is defined for six joints, this robot has {chain.n}")
    if chain.prismatic.any():
        raise ValueError("status is defined for six revolute joints, this robot has prismatic ones")
    given = np.asarray(readings, float)
    frames = chain.with_base(np.eye(4)).frames(joints.model(given))
    axes, points = frames[..., :6, :3, 2], frames[..., :6, :3, 3]
    wrist = _nearest(points[..., 3, :], axes[..., 3, :], points[..., 5, :], axes[..., 5, :])
    heading = np.deg2rad(given[..., 0]) * joints.sign[0] * axes[..., 0, 2]
    forward = np.stack([np.cos(heading), np.sin(heading), np.zeros_like(heading)], axis=-1)
    overhead = np.sum(forward * wrist, axis=-1) < 0.0
    upper, fore = points[..., 2, :] - points[..., 1, :], wrist - points[..., 2, :]
    elbow = joints.sign[2] * np.sum(axes[..., 2, :] * np.cross(upper, fore), axis=-1) >= 0.0
    return np.asarray(OVERHEAD * overhead + ELBOW * elbow + FLIPPED * (given[..., 4] < 0.0), np.int64)


def _nearest(point: Floats, along: Floats, other: Floats, its: Floats) -> Floats:
    """The point (..., 3) of the line `point` + s `along` that is nearest to the line `other` + t `its`; unit vectors.

    Of parallel lines, the one nearest to `other`.
    """
    apart, cosine = other - point, np.sum(along * its, axis=-1)
    ours, theirs = np.sum(apart * along, axis=-1), np.sum(apart * its, axis=-1)
    slope = 1.0 - cosine**2
    crossed = (ours - cosine * theirs) / np.where(slope > 1e-9, slope, 1.0)
    return np.asarray(point + np.where(slope > 1e-9, crossed, ours)[..., None] * along)
