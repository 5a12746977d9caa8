"""The true arm with its tool, ready to be carried: what of it never changes, worked out once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

from sims.world.nominal import Geometry, Matrix, vector
from sims.world.screws import Arm, Vector


@final
@dataclass(frozen=True, slots=True)
class Chain:
    """An arm and what it carries, at model zero in the base frame.

    `flange`, `tcp`: points, mm; `offset`: from one to the other; `flange_x`, `flange_z`, `tool_x`, `tool_z`:
    directions.
    """

    arm: Arm
    flange: Vector
    offset: Vector
    tcp: Vector
    flange_x: Vector
    flange_z: Vector
    tool_x: Vector
    tool_z: Vector


def chain_of(geometry: Geometry, tool: Matrix) -> Chain:
    """`tool`: 4×4, flange ← tool, mm."""
    turned, place = geometry.flange[:3, :3], geometry.flange[:3, 3]
    offset, directions = turned @ tool[:3, 3], turned @ tool[:3, :3]
    return Chain(
        arm=Arm(geometry.axes),
        flange=vector(place),
        offset=vector(offset),
        tcp=vector(offset + place),
        flange_x=vector(geometry.flange[:3, 0]),
        flange_z=vector(geometry.flange[:3, 2]),
        tool_x=vector(directions[:, 0]),
        tool_z=vector(directions[:, 2]),
    )
