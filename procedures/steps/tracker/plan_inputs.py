"""Inputs of the steps that plan poses, targets and circles, and the passes of later loops that follow from them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import Field, model_validator

from cellctl.procedure import StepInputs
from procedures.steps.batch_inputs import BatchPlanInputs

DEFAULT_METHOD = "pseudo-target"
"""Of compensation."""


class PlanInputs(BatchPlanInputs):
    """fit: poses to identify from; held_out: all that judge; monuments_every: poses between two visits to the nests.

    from_both: share of the fit's poses that are measured from both sides. reflectors: of the plate, all visible.
    pose_file: file of the poses, from the cell file's folder; empty: they are planned here. choice: of the poses of the
    fit, spread evenly, or those of many that leave the least predicted error; with a goal always these.
    """

    NOUN: ClassVar[str] = "poses"
    fit: Annotated[int, Field(ge=10, le=2000)]
    held_out: Annotated[int, Field(ge=0, le=1000)]
    first: Annotated[int, Field(ge=20)] = 30
    monuments_every: Annotated[int, Field(ge=5)] = 30
    from_both: Annotated[float, Field(ge=0, le=1)] = 0.15
    reflectors: Annotated[int, Field(ge=1, le=8)] = 1
    pose_file: str = ""
    choice: Literal["even", "optimal"] = "even"

    @property
    def late(self) -> int:
        """Held-out poses after all others of the plan; with a goal after the last batch, in a plan of their own."""
        return 0 if self.goal_mm else self.held_out // 2

    @model_validator(mode="after")
    def _planned_here(self) -> Self:
        if self.goal_mm and (self.pose_file or self.reflectors > 1):
            raise ValueError("with a goal, poses of one reflector are planned here: no pose_file, no more reflectors")
        return self


def poses_planned(known: Mapping[str, Any]) -> int:
    """Poses, and the return pose of each round."""
    fit = known.get("most" if known.get("goal_mm") else "fit", 0)
    poses = round(fit * (1.0 + known.get("from_both", 0.0)) + known.get("held_out", 0))
    return int(poses - (-poses // max(1, known.get("monuments_every", 1))))


class PlanTargetsInputs(StepInputs):
    """fit: poses to identify from if no model was read; registration: poses that register one that was read.

    targets: how many at most; target_file: file of the targets, from the cell file's folder; empty: they are planned.
    from_both: share of the identification's poses that are measured from both sides. method, passes, online: of
    compensation, as in `tracker.compensate`.
    """

    fit: Annotated[int, Field(ge=10, le=2000)]
    registration: Annotated[int, Field(ge=8, le=500)]
    targets: Annotated[int, Field(ge=3, le=500)]
    target_file: str = ""
    monuments_every: Annotated[int, Field(ge=5)] = 30
    from_both: Annotated[float, Field(ge=0, le=1)] = 0.15
    method: str = DEFAULT_METHOD
    passes: Annotated[int, Field(ge=0)] = 0
    online: bool = False


def targets_planned(known: Mapping[str, Any]) -> int:
    """Targets before and after, and the poses of the fit."""
    return 2 * int(known.get("targets", 0)) + int(known.get("fit", 0))


class TurnInputs(StepInputs):
    """Points of each circle."""

    points: Annotated[int, Field(ge=5, le=200)] = 9


def turns_planned(known: Mapping[str, Any]) -> int:
    """The first posture, and the points of four circles."""
    return 1 + 4 * int(known.get("points", 0))
