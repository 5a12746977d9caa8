"""Performance by ISO 9283, measured by a tracker: the steps of the family `iso9283`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import Field

from cellctl.procedure import StepDescription, StepInputs


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


STEPS = (
    StepDescription("iso9283.read_model", "._measuring", "reading the model"),
    StepDescription("iso9283.plan", "._measuring", "planning the cube", PlanInputs, visits_planned),
    StepDescription("iso9283.compensate", "._measuring", "compensating the five points", CycleInputs, visits_planned),
    StepDescription("iso9283.register", "._measuring", "registering the base frame"),
    StepDescription("iso9283.push", "._measuring", "pushing the table"),
    StepDescription("iso9283.measure", "._measuring", "measuring the five points"),
    StepDescription("iso9283.evaluate", "._measuring", "computing the figures"),
    StepDescription("iso9283.judge", "._measuring", "judging the table"),
)
