"""Inputs of the steps that plan the cycles, and the passes of later loops that follow from them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import Field

from cellctl.procedure import StepInputs


class CycleInputs(StepInputs):
    """cycles: how many. directions: whether P1, P2, P4 are visited from three directions, too. monuments_every: poses
    between two visits to the monuments.
    """

    cycles: Annotated[int, Field(ge=2, le=200)] = 30
    directions: bool = True
    monuments_every: Annotated[int, Field(ge=5)] = 70


class PlanInputs(CycleInputs):
    """edge: of the cube, mm; centre: `x, y, z` in the base frame, mm, empty: found; reflectors: visible everywhere."""

    edge: Annotated[float, Field(ge=100, le=2000)] = 400.0
    centre: str = ""
    reflectors: Annotated[int, Field(ge=1, le=8)] = 3


def visits_planned(known: Mapping[str, Any]) -> int:
    """Visits to the points, without those that register the base."""
    return int(known.get("cycles", 0)) * (14 if known.get("directions") else 5)
