"""The taught tool by four points: the steps of the family `tool`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import Field

from cellctl.procedure import StepDescription, StepInputs


class PlanInputs(StepInputs):
    """The sphere, tool orientations of the fit and held-out ones, and touches with each of them."""

    sphere: str
    orientations: Annotated[int, Field(ge=4, le=30)] = 8
    held_out: Annotated[int, Field(ge=2, le=30)] = 4
    touches: Annotated[int, Field(ge=3, le=20)] = 4


def touches_planned(known: Mapping[str, Any]) -> int:
    """Touches with all orientations."""
    return int((known.get("orientations", 0) + known.get("held_out", 0)) * known.get("touches", 0))


STEPS = (
    StepDescription("tool.plan", "._measuring", "planning touches", PlanInputs, touches_planned),
    StepDescription("tool.touch", "._measuring", "touching the sphere"),
    StepDescription("tool.solve_touches", "._measuring", "solving for the tool"),
    StepDescription("tool.read_pose", "._measuring", "reading the joints"),
    StepDescription("tool.solve_poses", "._measuring", "solving for the tool"),
)
