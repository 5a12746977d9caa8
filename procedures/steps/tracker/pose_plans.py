"""Planned measurements of a reflector in rounds, as steps hand them on; the model that is identified from them, and the
method that compensates them.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import Field, field_validator

from cellctl.compensation import METHODS
from cellctl.files import InputError, Problem
from cellctl.formats import ModelChoice, ModelTerms
from cellctl.procedure import CellContext, StepInputs, StepResult, did_you_mean
from procedures.steps.tracker.plan_inputs import DEFAULT_METHOD


def check_method(context: CellContext, known: Mapping[str, Any]) -> None:
    """Raise InputError if `method` of the known inputs is none of `cellctl.compensation`."""
    method = known.get("method", DEFAULT_METHOD)
    if method not in METHODS:
        what = f"there is no compensation method '{method}'"
        raise InputError(Problem("--set method", 0, 0, what, did_you_mean(str(method), METHODS)))


class ModelInputs(StepInputs):
    """Which model, as in `cellctl fit --model`."""

    model: ModelChoice = "auto"

    @field_validator("model")
    @classmethod
    def _known(cls, model: str) -> str:
        try:
            ModelTerms.parse(model)
        except InputError as error:
            [problem] = error.problems
            raise ValueError(f"{problem.what}: {problem.cure}") from error
        return model


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
