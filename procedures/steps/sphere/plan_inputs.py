"""Inputs of the steps that plan touches and stand-offs, and the passes of later loops that follow from them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal, Self, TypeAlias

from pydantic import Field, model_validator

from cellctl.procedure import StepInputs
from procedures.steps.batch_inputs import BatchPlanInputs
from procedures.steps.sphere.touch_plans import TouchPlan

TOUCHES_PER_SPHERE = 6
"""Touches of the fit that the verdict requires for each sphere: two numbers for each coordinate of its centre."""


def names_of(spheres: str) -> list[str]:
    """The spheres that a text names, separated by commas."""
    return [name.strip() for name in spheres.split(",") if name.strip()]


Choice: TypeAlias = Literal["even", "optimal"]
"""How the touches of the fit are chosen: spread evenly, or by the least predicted error."""


class PlanInputs(BatchPlanInputs):
    """Number of touches, spheres (names separated by commas; empty: all), and frequency of returns to the first.

    `reference_every`: touches between two visits to the first touch, 0 for none. `prove_on`: the later proof
    sphere of the model, which must not be among those of the fit. `use_distances`: of the later fit.
    """

    NOUN: ClassVar[str] = "touches"
    spheres: str = ""
    reference_every: Annotated[int, Field(ge=0)] = 0
    prove_on: str = ""
    choice: Choice = "even"
    use_distances: bool = True

    @property
    def names(self) -> list[str]:
        """The spheres by name; empty for all."""
        return names_of(self.spheres)

    @model_validator(mode="after")
    def _can_be_proved(self) -> Self:
        if self.prove_on.strip() and (not self.names or self.prove_on.strip() in self.names):
            used = "all spheres" if not self.names else "it"
            raise ValueError(f"sphere {self.prove_on} cannot prove a model that is made from {used}: name another one")
        least = TOUCHES_PER_SPHERE * len(self.names)
        if self.held_out and self.at_first < least:
            raise ValueError(f"{self.at_first} touches are too few to judge a model by others, {least} at least")
        return self


def touches_planned(known: Mapping[str, Any]) -> int:
    """Touches, and returns to the first one."""
    count = known.get("most" if known.get("goal_mm") else "fit", 0)
    touches, every = count + known.get("held_out", 0), known.get("reference_every", 0)
    return int(touches + (touches // every if every else 0))


class PlanProofInputs(StepInputs):
    """The proof sphere, the number of touches that locate it, and from how many times as many they are chosen.

    `tried`: 1, as in older procedures, plans the first touches in reach, which may all be on one side.
    """

    sphere: str
    touches: Annotated[int, Field(ge=4)] = 8
    tried: Annotated[int, Field(ge=1, le=16)] = 1


def touches_located(known: Mapping[str, Any]) -> int:
    """Touches that locate the proof sphere."""
    return int(known.get("touches", 0))


class CompensateInputs(StepInputs):
    """Stand-off targets on the proof sphere: their number, distance from its surface, and reference touch.

    `reference`: the touch to return to after each `reference_every` stand-offs (0: never).
    """

    sphere: str
    targets: Annotated[int, Field(ge=3, le=500)] = 30
    distance_mm: Annotated[float, Field(gt=0, le=20)] = 10.0
    reference: TouchPlan
    reference_every: Annotated[int, Field(ge=0)] = 0


def standoffs_planned(known: Mapping[str, Any]) -> int:
    """Each target has two stand-offs; a return to the reference follows each `reference_every` stand-offs."""
    targets, half = known.get("targets", 0), known.get("reference_every", 0) // 2
    return int(2 * targets + (targets // half if half else 0))
