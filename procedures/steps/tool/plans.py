"""The planning results for the steps that touch."""

from __future__ import annotations

from cellctl.procedure import StepResult
from procedures.steps.sphere.touch_plans import TouchPlan


class ToolTouchPlan(TouchPlan):
    """A planned touch and the number of its tool orientation, from 0."""

    orientation: int


class ToolPlan(StepResult):
    """All touches, in order."""

    touches: list[ToolTouchPlan]
