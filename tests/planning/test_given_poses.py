"""Measuring poses of a file: each is visited once, with its set; what cannot be measured is refused by its line."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cellctl.files import InputError, load_yaml
from cellctl.formats import DataSet
from procedures.steps.tracker.plan_inputs import PlanInputs
from procedures.steps.tracker.pose_planning import planned_rounds
from procedures.steps.tracker.pose_plans import PosePlan
from tests.helpers.runs import ROOT

ROBOT_FILE = ROOT / "procedures" / "robots" / "kr5_r1400.yaml"
CELL = load_yaml(ROOT / "procedures" / "cells" / "tracker_cell.yaml")
BEHIND = [120.0, -76.0, 106.0, 4.0, 90.0, 89.0]


def planned(fit: int, held_out: int, pose_file: str = "") -> list[PosePlan]:
    context: Any = SimpleNamespace(cell=CELL, robot_file=ROBOT_FILE, seed=3)
    wanted = PlanInputs(fit=fit, held_out=held_out, monuments_every=40, from_both=0.0, pose_file=pose_file)
    return [pose for part in planned_rounds(context, wanted, None) for pose in part.poses]


@pytest.fixture(scope="module")
def measurable() -> list[list[float]]:
    return [pose.joints for pose in planned(20, 6)]


def written(folder: Path, postures: list[list[float]], sets: list[str]) -> str:
    rows = [
        {**{f"A{axis}": angle for axis, angle in enumerate(joints, 1)}, "set": of}
        for joints, of in zip(postures, sets, strict=True)
    ]
    DataSet.of_records(rows, "poses.csv").write(folder / "poses.csv")
    return str(folder / "poses.csv")


def test_the_first_poses_of_each_set_are_visited_once_as_the_file_has_them(
    tmp_path: Path, measurable: list[list[float]]
) -> None:
    file = written(tmp_path, measurable, ["test"] * 8 + ["fit"] * 18)
    visited = planned(12, 6, file)
    for of, postures in (("fit", measurable[8:20]), ("test", measurable[:6])):
        found = [pose.joints for pose in visited if pose.kind == of]
        assert sorted(found) == sorted(np.round(postures, 4).tolist())


def test_a_pose_that_cannot_be_measured_is_passed_over(tmp_path: Path, measurable: list[list[float]]) -> None:
    file = written(tmp_path, [BEHIND, *measurable], ["fit"] * 21 + ["test"] * 6)
    visited = [pose.joints for pose in planned(20, 6, file) if pose.kind == "fit"]
    assert sorted(visited) == sorted(np.round(measurable[:20], 4).tolist())


def test_too_few_poses_of_a_set_are_refused_with_the_lines_that_cannot_be_measured(
    tmp_path: Path, measurable: list[list[float]]
) -> None:
    file = written(tmp_path, [*measurable[:10], BEHIND, *measurable[10:]], ["fit"] * 21 + ["test"] * 6)
    with pytest.raises(InputError) as caught:
        planned(21, 6, file)
    count, refused = caught.value.problems
    assert count.what == "20 targets of set 'fit' can be measured; the procedure asks for 21"
    assert refused.line == 12
    assert "no reflector faces the station" in refused.what
