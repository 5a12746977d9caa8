"""What planning hands on to the steps that move."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from cellctl.procedure import StepResult

Joints = Annotated[list[float], Field(min_length=1, max_length=20)]
"""Joint readings, degrees."""


class TouchPlan(StepResult):
    """One touch to come: joints in degrees, see `cellctl.planning.PlannedTouch`.

    `set`: to identify from, held out, to locate the proof sphere, or a return to touch number `repeats`.
    """

    number: int
    sphere: str
    set: Literal["fit", "test", "locate", "reference"]
    approach: list[Joints]
    start: Joints
    end: Joints
    search_mm: float
    retreat: list[Joints]
    repeats: int | None = None
