"""What gravity does about each axis of an arm, in plain floats: it is asked for wherever the arm's place is.

Weights are summed from the flange inwards, so that one vector is turned about each axis and not every link's centre.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import cos, sin
from typing import final

from sims.world.screws import Axis, Vector

GRAVITY_M_S2 = 9.80665

Turn = tuple[float, float]
"""Cosine and sine of a joint's angle."""


@final
@dataclass(frozen=True, slots=True)
class Mass:
    """A weight (N) and its centre at model zero, mm, base frame."""

    weight_n: float
    centre: Vector

    def together(self, other: Mass) -> Mass:
        """Both weights, at their common centre."""
        total = self.weight_n + other.weight_n
        if total == 0.0:
            return self
        x, y, z = (
            (self.weight_n * a + other.weight_n * b) / total for a, b in zip(self.centre, other.centre, strict=True)
        )
        return Mass(total, (x, y, z))


def turns(angles: Sequence[float]) -> list[Turn]:
    """Of model angles in rad."""
    return [(cos(angle), sin(angle)) for angle in angles]


def levers(axes: Sequence[Axis], links: Sequence[Mass], turned: Sequence[Turn]) -> list[Vector]:
    """Weight times way from each axis' point to the centre of all that it carries, N·mm.

    Joints beyond the axis stand as `turned` says, it and those before it at zero.
    """
    found = []
    total = sx = sy = sz = 0.0
    for axis, link, turn in zip(reversed(axes), reversed(links), reversed(turned), strict=True):
        px, py, pz = axis.point
        cx, cy, cz = link.centre
        w = link.weight_n
        total += w
        lever = sx + w * cx - total * px, sy + w * cy - total * py, sz + w * cz - total * pz
        found.append(lever)
        x, y, z = turned_about(axis.direction, turn, lever)
        sx, sy, sz = total * px + x, total * py + y, total * pz + z
    found.reverse()
    return found


def torques(axes: Sequence[Axis], found: Sequence[Vector], turned: Sequence[Turn], down: Vector) -> list[float]:
    """Of gravity about each axis, in its sense of rotation, N·mm, at the `levers` of that pose.

    `down`: which way it pulls, a unit vector in the base frame.
    """
    out = []
    for axis, (x, y, z), (c, s) in zip(axes, found, turned, strict=True):
        down = turned_about(axis.direction, (c, -s), down)  # gravity as the link sees it
        gx, gy, gz = down
        ux, uy, uz = axis.direction
        out.append(ux * (y * gz - z * gy) + uy * (z * gx - x * gz) + uz * (x * gy - y * gx))
    return out


def turned_about(direction: Vector, turn: Turn, vector: Vector) -> Vector:
    """A vector turned about a unit direction (Rodrigues)."""
    ux, uy, uz = direction
    x, y, z = vector
    c, s = turn
    along = (1.0 - c) * (ux * x + uy * y + uz * z)
    return (
        c * x + s * (uy * z - uz * y) + along * ux,
        c * y + s * (uz * x - ux * z) + along * uy,
        c * z + s * (ux * y - uy * x) + along * uz,
    )
