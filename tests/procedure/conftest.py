"""A small family of steps and a procedure that uses them well."""

import textwrap
from pathlib import Path
from typing import Annotated, Literal

import pytest
from pydantic import Field

from cellctl.devices import ContactProbe, SearchingRobot
from cellctl.files import parse_yaml
from cellctl.procedure import (
    NoInputs,
    Procedure,
    StepContext,
    StepInputs,
    StepRegistry,
    StepResult,
    check,
    read_procedure,
    step,
)


class PlanInputs(StepInputs):
    fit: Annotated[int, Field(ge=10, le=2000, description="touches to identify from")]
    held_out: int = 30
    order: Literal["random", "nearest"] = "random"


class Target(StepResult):
    joints: list[float]
    name: str


class Plan(StepResult):
    touches: list[Target]
    seconds: float | None = None
    by_sphere: Annotated[dict[str, Target], Field(default_factory=dict)]


class TouchInputs(StepInputs):
    touch: Target
    speed_mm_s: Annotated[float, Field(gt=0, le=20)]
    options: Annotated[dict[str, float], Field(default_factory=dict)]
    ladder: Annotated[list[float], Field(default_factory=list)]


class Gouged(Exception):
    """The tip has gone into the sphere."""


@step("sphere.plan")
async def plan(context: StepContext, inputs: PlanInputs) -> Plan:
    """Plan the touches.

    More words that no summary needs.
    """
    target = Target(joints=[0.0], name=f"of {inputs.fit}")
    return Plan(touches=[target], by_sphere={})


@step("sphere.touch", needs={"robot": SearchingRobot, "probe": ContactProbe}, moves=True, errors=(Gouged,))
async def touch(context: StepContext, inputs: TouchInputs) -> None:
    """Touch once."""


@step("sphere.weigh", uses={"probe": ContactProbe})
async def weigh(context: StepContext, inputs: NoInputs) -> None:
    """A step that a cell without a probe can do too."""


@step("robot.stop", needs={"robot": SearchingRobot})
async def stop(context: StepContext, inputs: NoInputs) -> None:
    """Hold the robot."""


GOOD = """\
procedure: sphere_selfcal
title: Three spheres
cell: ../cells/sphere_cell.yaml
parameters:
  touches_fit: {type: integer, default: 50, min: 10, max: 2000, unit: touches, help: touches to identify from}
  search_speed: {type: number, default: 5, min: 0.5, max: 20, unit: mm/s}
  order: {type: text, default: random, choices: [random, nearest]}
  quick: {type: flag, default: false}
steps:
  - id: plan
    do: sphere.plan
    with: {fit: "${touches_fit}", order: "${order}"}
    timeout: 10
  - id: points
    for_each: ${plan.touches}
    as: touch
    steps:
      - id: touch
        do: sphere.touch
        with: {touch: "${touch}", speed_mm_s: "${search_speed}"}
        timeout: 90
        retry: {attempts: 2, on: [NoContact]}
cleanup:
  - {id: hold, do: robot.stop, timeout: 10}
"""

DEVICES = {"robot": None, "probe": None}


@pytest.fixture
def registry():
    return StepRegistry([plan, touch, weigh, stop])


@pytest.fixture
def load():
    """A procedure of the given text."""

    def read(text: str) -> Procedure:
        return read_procedure(parse_yaml(textwrap.dedent(text), str(Path("procedures") / "p.yaml")))

    return read


@pytest.fixture
def errors(load, registry):
    """The errors in a procedure, as text without the file's name."""

    def find(text: str, parameters=None, devices=DEVICES) -> list[str]:
        procedure = load(text)
        values = {p.name: p.default for p in procedure.parameters.values() if p.default is not None}
        return [
            str(problem).removeprefix("procedures/p.yaml:")
            for problem in check(procedure, values if parameters is None else parameters, registry, devices)
        ]

    return find


@pytest.fixture
def good() -> str:
    return GOOD
