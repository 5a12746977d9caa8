"""Product of screws (POE): points and directions carried through revolute axes, in plain floats.

A frame at model zero is carried by `p(θ) = e^{ξ1 θ1} … e^{ξn θn} p(0)`, each factor a turn about an axis fixed in the
base frame. Unrolled over x, y, z because this runs in every interpolation cycle: numpy would cost ten times as much.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import cos, sin
from typing import final

Vector = tuple[float, float, float]
"""x, y, z in the robot's base frame; mm for points, without unit for directions."""


@final
@dataclass(frozen=True, slots=True)
class Axis:
    """A revolute joint's axis at model zero: a point on it (mm, base frame) and its unit direction."""

    point: Vector
    direction: Vector


@final
class Arm:
    """A serial chain of revolute axes, base first."""

    __slots__ = ("_outward_in", "axes")

    def __init__(self, axes: Sequence[Axis]) -> None:
        self.axes = tuple(axes)
        self._outward_in = [axis.direction + axis.point for axis in reversed(self.axes)]

    def carry(self, angles: Sequence[float], point: Vector, *directions: Vector) -> tuple[Vector, ...]:
        """Where `point` (mm) and `directions`, given at model zero, are at model `angles` (rad); the point first."""
        x, y, z = point
        turned = list(directions)
        for (wx, wy, wz, px, py, pz), angle in zip(self._outward_in, reversed(angles), strict=True):
            c = cos(angle)
            s = sin(angle)
            x -= px
            y -= py
            z -= pz
            along = (1.0 - c) * (wx * x + wy * y + wz * z)
            x, y, z = (
                px + c * x + s * (wy * z - wz * y) + along * wx,
                py + c * y + s * (wz * x - wx * z) + along * wy,
                pz + c * z + s * (wx * y - wy * x) + along * wz,
            )
            for i, (u, v, w) in enumerate(turned):
                along = (1.0 - c) * (wx * u + wy * v + wz * w)
                turned[i] = (
                    c * u + s * (wy * w - wz * v) + along * wx,
                    c * v + s * (wz * u - wx * w) + along * wy,
                    c * w + s * (wx * v - wy * u) + along * wz,
                )
        return (x, y, z), *turned
