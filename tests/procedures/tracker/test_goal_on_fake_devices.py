"""Tracker campaigns in batches, on devices without wires: what ends them; held-out poses take no part in it."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from itertools import pairwise, takewhile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cellctl.engine import State
from cellctl.files import load_yaml
from cellctl.procedure import StepRegistry
from cellctl.records import ENDED, BatchRow, Row
from procedures.steps.tracker.batches import KnownPoses
from procedures.steps.tracker.plan_inputs import PlanInputs, poses_planned
from procedures.steps.tracker.pose_plans import Round
from procedures.steps.tracker.rows import (
    MonumentsRow,
    NestRow,
    PoseRow,
    ReturnRow,
    SetUpRow,
    StationRow,
    TargetsRow,
    TrackerVerdict,
)
from tests.helpers.steps import CELL, PROCEDURES, ROBOT, Context, FakeRun, run_fake

PROCEDURE = PROCEDURES / "tracker_calibration.yaml"
FEW: dict[str, Any] = {
    "goal": 0.03,
    "poses_first": 20,
    "poses_test": 21,
    "monuments_every": 20,
    "turn_points": 5,
    "model": "geometry",
}
KINDS: tuple[type[Row], ...] = (SetUpRow, StationRow, MonumentsRow, NestRow, ReturnRow, PoseRow)
ASKED: dict[str, Any] = {"batch": 0, "goal_mm": 0.001, "size": 10, "most": 60, "held_out": 21, "model": "geometry"}


@pytest.fixture(scope="module")
def stopped(tmp_path_factory: pytest.TempPathFactory) -> FakeRun:
    """A campaign that has ended at its goal, after a second batch."""
    return run_fake(PROCEDURE, tmp_path_factory.mktemp("stopped"), FEW)


def rows_before_first_batch(run: FakeRun) -> Context:
    """What the step knew that planned the first batch."""
    kinds = {kind.KIND: kind for kind in KINDS}
    before = takewhile(lambda each: each.event.row_kind != BatchRow.KIND, run.journal.rows)
    kept = [kinds[each.event.row_kind].read(each.event.data) for each in before if each.event.row_kind in kinds]
    context = Context(rows=kept, robot_file=ROBOT, cell=load_yaml(CELL))
    context.seed = 1  # type: ignore[attr-defined]
    return context


def decided(context: Context, **inputs: Any) -> tuple[BatchRow, list[Round]]:
    kind = StepRegistry.installed().find("tracker.next_round")
    found = asyncio.run(kind(context, kind.inputs(**{**ASKED, **inputs})))
    return context.recorded(BatchRow)[-1], found.rounds


@pytest.mark.long
def test_it_stops_at_its_goal_and_the_robot_is_better(stopped: FakeRun) -> None:
    assert stopped.outcome.state is State.FINISHED, stopped.outcome.error
    curve = stopped.journal.recorded(BatchRow)
    assert [row.ended for row in curve] == ["", "goal"]
    assert [row.rows for row in curve] == [20, 30]
    assert curve[0].high_mm > FEW["goal"] >= curve[1].high_mm
    assert curve[0].next_mm == pytest.approx(curve[1].high_mm, rel=0.15), "the forecast came true"
    found = stopped.journal.recorded(TrackerVerdict)
    assert [row.verdict for row in found] == ["better", "better"]
    assert "Goal of 0.03 mm met (predicted below" in found[0].lines[0]


def test_each_pose_has_a_number_of_its_own_and_half_of_the_held_out_ones_come_last(stopped: FakeRun) -> None:
    poses = stopped.journal.recorded(PoseRow)
    numbers = [row.number for row in poses]
    assert all(before < after for before, after in pairwise(numbers))
    sets = [row.set for row in poses]
    assert sets[-10:] == ["test"] * 10
    assert sets[: 20 + 3 + 11].count("test") == 11
    assert sets[34:-10] == ["fit"] * 12, "ten poses, two of them from both sides"
    fit = np.array([row.commanded for row in poses if row.set == "fit"])
    late = np.array([row.commanded for row in poses[-10:]])
    assert ((late >= fit.min(axis=0)) & (late <= fit.max(axis=0))).all()
    assert stopped.journal.recorded(TargetsRow)[0].rows + len(stopped.journal.recorded(TargetsRow)[0].left_out) == 21


def test_the_same_rows_decide_the_same(stopped: FakeRun) -> None:
    """What replay relies on."""
    context = rows_before_first_batch(stopped)
    row, rounds = decided(context, goal_mm=0.03, most=150)
    assert row == stopped.journal.recorded(BatchRow)[0]
    planned = [pose.joints for each in rounds for pose in each.poses]
    measured = [row.commanded for row in stopped.journal.recorded(PoseRow)[34:46]]
    np.testing.assert_allclose(planned, measured)


@pytest.mark.parametrize(
    ("inputs", "ended"),
    [({"goal_mm": 1.0}, "goal"), ({"most": 20}, "rows"), ({"minutes": 5.0}, "time"), ({"gain_percent": 90.0}, "gain")],
)
def test_it_ends_and_states_why(stopped: FakeRun, inputs: dict[str, Any], ended: str) -> None:
    row, rounds = decided(rows_before_first_batch(stopped), **inputs)
    assert row.ended == ended
    assert ENDED[ended] in row.sentence
    assert [pose.kind for each in rounds for pose in each.poses] == ["test"] * 10


def test_after_the_end_nothing_is_planned(stopped: FakeRun) -> None:
    planned = [result for path, result in stopped.journal.finished.items() if path.endswith(".next")]
    assert len(planned) == 14, "as many passes as batches at most"
    assert all(not result["rounds"] and result["ended"] == "goal" for result in planned[2:])


@pytest.mark.long
def test_held_out_poses_take_no_part_in_the_decision(stopped: FakeRun) -> None:
    context, rng = rows_before_first_batch(stopped), np.random.default_rng(1)
    row, rounds = decided(context)
    for place, each in enumerate(context.rows):
        if isinstance(each, PoseRow) and each.set == "test":
            xyz = tuple((np.array(each.point.xyz) + rng.uniform(-9.0, 9.0, 3)).tolist())
            context.rows[place] = replace(each, point=replace(each.point, xyz=xyz), joints=each.commanded)
    again, planned = decided(context)
    assert again == row
    assert planned == rounds


def test_limits_count_postures_though_some_are_measured_from_both_sides(stopped: FakeRun) -> None:
    context = rows_before_first_batch(stopped)
    known = KnownPoses.of(context, context.recorded(PoseRow), "geometry")  # type: ignore[arg-type]
    assert (known.forecast.rows, len(known.records)) == (20, 23)
    assert known.forecast.each == pytest.approx(23 / 20)


@pytest.mark.long
def test_a_goal_that_is_not_reached_is_no_success(tmp_path: Path) -> None:
    run = run_fake(PROCEDURE, tmp_path, FEW | {"goal": 0.001, "poses_most": 24, "poses_test": 12})
    assert [row.ended for row in run.journal.recorded(BatchRow)] == ["", "rows"]
    found = run.journal.recorded(TrackerVerdict)[-1]
    assert (found.verdict, found.better, found.passed) == ("not met", True, False)
    assert found.sentence.endswith("The goal of 0.001 mm is not met.")
    assert run.robot.tables, "the proved table stays in force"


def test_plans_with_a_goal_count_the_most_poses_and_refuse_what_they_cannot_plan() -> None:
    common = {"held_out": 50, "from_both": 0.0, "monuments_every": 1000, "fit": 80, "most": 150}
    assert poses_planned(common) == 80 + 50 + 1
    assert poses_planned({**common, "goal_mm": 0.1}) == 150 + 50 + 1
    with pytest.raises(ValueError, match="20 poses at most are fewer than the first 30"):
        PlanInputs(fit=80, held_out=50, goal_mm=0.1, most=20)
    with pytest.raises(ValueError, match="no pose_file"):
        PlanInputs(fit=80, held_out=50, goal_mm=0.1, pose_file="poses.csv")
