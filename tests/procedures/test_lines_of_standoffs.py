"""Search lines of stand-offs begin off the sphere and end below its surface, however far off the nominal robot is."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cellctl.files import InputError, load_yaml
from cellctl.planning import PlannedTouch, TouchOptions
from procedures.steps.sphere._standoffs import _lines_that_reach
from tests.helpers.runs import ROOT

CELL = load_yaml(ROOT / "procedures" / "cells" / "ur10e_cell.yaml")
DEFAULT = TouchOptions(guard=10.0, depth=8.0)
REACH_MM = 31.3


def lines_for(errors_mm: list[float]) -> tuple[list[TouchOptions], list[PlannedTouch], float]:
    """The plans that were made, the last one's lines, and their targets' distance.

    The robot of these has one joint, whose reading is the distance off the surface by the nominal model.
    """
    asked = []

    def planned(options: TouchOptions) -> list[PlannedTouch]:
        asked.append(options)
        ends = (options.guard,), (-options.depth,)
        return [PlannedTouch("P1", (99.0,), (), *ends, options.guard + options.depth, ()) for _ in errors_mm]

    model: Any = SimpleNamespace(robot=SimpleNamespace(joint_map=lambda: SimpleNamespace(model=np.asarray)))
    identified = SimpleNamespace(distances=lambda q: REACH_MM + q[:, 0] + np.array(errors_mm))
    sphere: Any = SimpleNamespace(identified=identified, reach=REACH_MM)
    context: Any = SimpleNamespace(cell=CELL)
    lines, off_mm = _lines_that_reach(context, model, sphere, 10.0, planned)
    return asked, lines, off_mm


@pytest.mark.parametrize("errors_mm", [[0.0, 0.1], [-6.5, 6.5], [-8.9, 6.9]])
def test_lines_are_planned_once_where_they_reach(errors_mm: list[float]) -> None:
    asked, _, off_mm = lines_for(errors_mm)
    assert asked == [DEFAULT]
    assert off_mm == 10.0


@pytest.mark.parametrize("errors_mm", [[1.0, 8.61], [-12.0, 0.0], [-11.3, 12.0]])
def test_lines_of_a_robot_that_is_farther_off_still_meet_the_surface(errors_mm: list[float]) -> None:
    _, lines, off_mm = lines_for(errors_mm)
    starts, ends = (np.array(q)[:, 0] + errors_mm for q in ([x.start for x in lines], [x.end for x in lines]))
    assert starts.min() >= 1.0
    assert ends.max() <= -1.0
    assert off_mm == lines[0].start[0]
    assert lines[0].search_mm <= 18.0 + 2 * 8.0


@pytest.mark.parametrize("error_mm", [-18.0, 16.0])
def test_a_robot_that_is_too_far_off_is_refused_with_what_to_do(error_mm: float) -> None:
    with pytest.raises(InputError, match="too far off at the proof sphere") as refused:
        lines_for([0.0, error_mm])
    assert "maker's calibration" in str(refused.value)
