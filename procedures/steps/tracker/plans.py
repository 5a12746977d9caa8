"""The planning results for the steps that move."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from cellctl.procedure import StepResult

Joints = Annotated[list[float], Field(min_length=1, max_length=20)]
"""Joint readings, degrees."""


class PosePlan(StepResult):
    """One planned measurement of a reflector; joints in degrees.

    number: in its plan. kind: to identify from, held out, reached by row `row` of the table, the return pose, a point
    of the circle about `axis` alone, or of the ISO cube. origin: where the last motion ended. way: from there, the
    approach last. direction: of each joint from the approach to `joints`, 1, -1 or 0. target: of a held-out pose, mm,
    in the instrument's frame of the first session.
    """

    number: int
    kind: Literal["fit", "test", "compensated", "return", "turn", "cube"]
    reflector: str
    origin: Joints
    way: list[Joints]
    joints: Joints
    direction: list[int]
    axis: int | None = None
    row: int | None = None
    target: list[float] | None = None


class Round(StepResult):
    """Poses, followed by a visit to the monuments and the return pose."""

    poses: list[PosePlan]
    back: PosePlan
