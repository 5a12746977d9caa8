"""Planned touches and stand-offs, as steps hand them on. Joints in degrees, lengths in mm."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from cellctl.procedure import StepResult

_IMPLAUSIBLE_SHARE = 0.1
"""A touch's line is 10 mm to the expected surface and 8 mm beyond: a contact over 8.2 mm too early is not with the
sphere. Robots of this class, with the sphere within some millimetres of its rough place, are up to 6.5 mm too early."""

_UNFORESEEN_MM, _AT_ALL_MM = 4.0, 0.5
"""Largest distance, mm, of a stand-off's contact before the predicted place; and the least travel."""

Joints = Annotated[list[float], Field(min_length=1, max_length=20)]
"""Joint readings, degrees."""

TouchSet = Literal["fit", "test", "locate", "reference"]


class TouchPlan(StepResult):
    """One planned touch: joints in degrees, see `cellctl.planning.PlannedTouch`.

    `set`: to identify from, held out, to locate the proof sphere, or a return to touch number `repeats`.
    """

    number: int
    sphere: str
    set: TouchSet
    origin: Joints
    approach: list[Joints]
    start: Joints
    end: Joints
    search_mm: float
    retreat: list[Joints]
    repeats: int | None = None

    @property
    def earliest_mm(self) -> float:
        """A contact earlier than this on the line is not with the sphere: it would be far from its expected place."""
        return _IMPLAUSIBLE_SHARE * self.search_mm


class StandOffPlan(StepResult):
    """One planned stand-off: go to a target off the sphere, then search along its normal until contact.

    `number`: the target, from 0; `run`: with nominal joints before, with the pushed table's `row` after. `nominal`: the
    target's joints without compensation, `commanded`: the commanded joints, degrees. `normal`: unit vector from the
    sphere's centre. `distance_mm`: of the target from the surface. `expected_mm`: the error predicted by the identified
    model, `sigma_mm`: its 1 σ.
    """

    number: int
    run: Literal["before", "after"]
    row: int | None
    sphere: str
    origin: Joints
    approach: list[Joints]
    nominal: Joints
    commanded: Joints
    end: Joints
    search_mm: float
    retreat: list[Joints]
    normal: list[float]
    distance_mm: float
    expected_mm: float
    sigma_mm: float

    @property
    def start(self) -> Joints:
        """The search's start, which is the commanded position."""
        return self.commanded

    @property
    def earliest_mm(self) -> float:
        """An earlier contact on the line is not with the sphere: neither nominal robot nor model explains it."""
        return max(_AT_ALL_MM, self.distance_mm + self.expected_mm - _UNFORESEEN_MM)


class Round(StepResult):
    """Stand-offs, each target's before and after together, followed by the return to the reference touch."""

    standoffs: list[StandOffPlan]
    references: list[TouchPlan]
