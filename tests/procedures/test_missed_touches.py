"""After a touch that found nothing the robot searches where the touches before show the sphere, or not at all."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cellctl.files import load_yaml
from cellctl.formats import RobotFile
from procedures.steps.sphere._missed import line_after_miss
from procedures.steps.sphere.planning import as_plan, plan_on
from procedures.steps.sphere.rows import TouchRow
from procedures.steps.sphere.touch_plans import TouchPlan
from tests.helpers.runs import ROOT
from tests.helpers.steps import CONTACT, Context

CELL = load_yaml(ROOT / "procedures" / "cells" / "ur10e_cell.yaml")
ROBOT = ROOT / "procedures" / "robots" / "ur10e_probe.yaml"
CENTRE, REACH_MM = np.array([700.0, 350.0, 100.0]), 31.3


def tips_of(readings: list[list[float]]) -> Any:
    """The tip (N, 3), mm, by the nominal robot."""
    robot = RobotFile.load(ROBOT)
    return robot.chain().forward(robot.joint_map().model(readings))[:, :3, 3]


@pytest.fixture(scope="module")
def touches() -> list[TouchPlan]:
    context: Any = Context(robot_file=Path(ROBOT), cell=CELL)
    context.seed = 2
    return [as_plan(number, touch, "fit") for number, touch in enumerate(plan_on(context, {"S2": 7}, 2))]


def after_miss(touches: list[TouchPlan], made: int, depth_mm: float, **missed: Any) -> TouchPlan | None:
    """The line after the last of `touches` is missed. The sphere appears so much deeper along that line; the first
    `made` met it there.
    """
    context: Any = Context(robot_file=Path(ROBOT), cell=CELL)
    inwards = [np.subtract(*tips_of([plan.end, plan.start])) for plan in touches]
    inwards = [each / np.linalg.norm(each) for each in inwards]
    for plan, along in zip(touches[:made], inwards, strict=False):
        share = (10.0 + depth_mm * along @ inwards[-1]) / 18.0
        joints = tuple((np.array(plan.start) + share * (np.array(plan.end) - np.array(plan.start))).tolist())
        context.rows.append(
            TouchRow(**CONTACT | {"number": plan.number, "sphere": "S2", "set": "fit", "joints": joints})
        )
    return line_after_miss(context, touches[-1].model_copy(update=missed))


@pytest.mark.parametrize(("made", "least_mm"), [(3, 2.0), (6, 5.0)])
def test_the_line_is_an_ordinary_one_to_where_the_sphere_appears(
    touches: list[TouchPlan], made: int, least_mm: float
) -> None:
    line = after_miss(touches, made, 6.0)
    assert line is not None
    start, end = REACH_MM - np.linalg.norm(tips_of([line.start, line.end]) - CENTRE, axis=1)
    assert -10.0 + least_mm < start < -3.0
    assert 8.0 + least_mm < end < 15.0
    assert line.search_mm == pytest.approx(18.0, abs=0.2)
    assert np.linalg.norm(np.subtract(line.end, line.start)) <= 4.5
    assert line.origin == touches[-1].retreat[-1] == line.retreat[-1]
    assert line.approach == [line.retreat[1]]


def test_a_miss_that_the_touches_before_do_not_explain_is_not_followed_by_a_deeper_line(
    touches: list[TouchPlan],
) -> None:
    assert after_miss(touches, 0, 6.0) is None, "the lead of this sphere may be off"
    assert after_miss(touches, 6, -0.5) is None, "the others found the surface where it is expected"
    assert after_miss(touches, 2, -3.0) is None
    assert after_miss(touches, 6, 6.0, set="reference") is None, "this very line met the sphere before"
    assert after_miss(touches, 6, 17.0) is None, "farther off than the clearance of all ways"
