"""Campaigns that stop at a goal: is it met in truth, and what do they save against a fixed number of touches?

KR5 robots of the simulated sphere cell, three certified spheres. The steps `sphere.plan`, `sphere.next_batch` and
`sphere.identify` of `sphere_selfcal` plan, decide and judge; the touches are those of the simulated world, without the
wires. Truth: 3-D RMS over the joint ranges for which the goal is, the best rigid motion removed. Fixed: as many touches
for all robots, spread evenly, as `sphere_selfcal` makes them without a goal. Tracker: does the quantile by which
`tracker_calibration` ends bound the true error, after so many planned poses measured without wires?
"""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from cellctl.calibration import Split, fit
from cellctl.formats import ModelFile, RobotFile, measurements
from cellctl.records import BatchRow
from procedures.steps.batches import Forecast, Task
from procedures.steps.sphere.rows import ReferenceRow, SphereVerdict, TouchRow
from procedures.steps.tracker.plan_inputs import PlanInputs
from procedures.steps.tracker.pose_planning import planned_rounds
from sims.cell import read_cell
from sims.world.world import World
from tests.helpers.arms import KR5_FILE
from tests.helpers.simulated_data import TRACKER_CELL, best_rigid, workspace_of
from tests.helpers.touch_campaign import SPHERES, TouchCampaign
from tests.studies._runner import Row, Study, Table, each
from tests.studies.planned_poses import cell_context, measured_rows, reflector

MOST, HELD_OUT, BATCH, EVERY, POSTURES = 150, 30, 10, 20, 256
FIXED = (50, 65, 80)
POSES = (20, 30, 40)
POSES_HELD_OUT = 10
"""They say where the tracker's error counts."""


def measure(seed: int, goal: float = 0.0, fixed: int = 0, poses: int = 0) -> Row:
    """A campaign of touches, or the forecast after so many poses of a tracker."""
    return of_poses(seed, poses) if poses else of_touches(seed, goal, fixed)


def of_poses(seed: int, count: int) -> Row:
    """The predicted error, by which the campaign would end, and the true one, mm."""
    robot, world = RobotFile.load(KR5_FILE), World(read_cell(TRACKER_CELL), seed)
    inputs = PlanInputs(fit=count, held_out=POSES_HELD_OUT, choice="optimal")
    planned = [pose for each in planned_rounds(cell_context(seed), inputs, None) for pose in each.poses]
    data = measured_rows(world, [pose for pose in planned if pose.kind == "fit"], robot.repeatability, seed)
    measured = measurements(robot, data, measure="position")
    result = fit(measured.task, Split(np.arange(len(data.lines)), ()))
    task = Task.of(((pose.kind, tuple(pose.joints)) for pose in planned), robot.joint_map())
    forecast = Forecast.of(count, measured.task, result, task)
    predicted = result.identification.identified.state.model.tcp(task.places)
    places = robot.joint_map().readings(task.places).tolist()
    true = np.array([reflector(world, each, (0.0, 0.0, 0.0)) for each in places])
    error = best_rigid(predicted, true).apply(predicted) - true
    now = forecast.error.now
    return {
        "true": float(np.sqrt(np.mean(np.sum(error**2, axis=1)))),
        "median": now.median_mm,
        "high": now.high_mm,
        "doubt": forecast.doubt,
        "model": result.model,
    }


def of_touches(seed: int, goal: float, fixed: int) -> Row:
    """One campaign: with a goal, or with a fixed number of touches; what it predicts, and the truth, mm."""
    with TemporaryDirectory() as folder:
        campaign = TouchCampaign(seed, Path(folder))
        context, spheres = campaign.context, ", ".join(SPHERES)
        common = {"spheres": spheres, "reference_every": EVERY, "goal_mm": goal, "most": MOST, "held_out": HELD_OUT}
        plan = campaign.do("sphere.plan", fit=fixed or MOST, **common)
        campaign.touch(plan.touches)
        for batch in plan.batches:
            following = campaign.do("sphere.next_batch", batch=batch, size=BATCH, reference=plan.touches[0], **common)
            campaign.touch(following.touches)
        campaign.do("sphere.identify", goal_mm=goal)
        model = ModelFile.load(Path(folder) / "model.json")
        verdict, curve = context.recorded(SphereVerdict)[-1], context.recorded(BatchRow)
        rows = context.recorded(TouchRow)
        return {
            "true": campaign.error(model, campaign.goal_places(model, HELD_OUT)),
            "true_workspace": campaign.error(model, workspace_of(model.robot, POSTURES)),
            "touches": sum(row.set == "fit" for row in rows),
            "made": len(rows) + len(context.recorded(ReferenceRow)),
            "verdict": verdict.verdict,
            "ended": curve[-1].ended if curve else "",
            "curve": [[row.rows, row.low_mm, row.median_mm, row.high_mm, row.next_mm, row.to_goal] for row in curve],
        }


def units(asked: Namespace) -> Iterator[Row]:
    """Each robot with each goal, and with each fixed number."""
    yield from each(goal=asked.goals, fixed=[0], seed=asked.seeds)
    yield from each(goal=[0.0], fixed=asked.fixed, seed=asked.seeds)
    yield from each(poses=POSES, seed=range(201, 201 + asked.tracker))


def tables(found: list[Row], asked: Namespace) -> Iterator[Table]:
    """A line for each goal, and for each fixed number by each goal; then the tracker's, where there are rows of it."""
    touched, posed = ([row for row in found if name in row] for name in ("goal", "poses"))
    lines = [
        "| touches of the fit | robots | met in truth | claimed | claimed, and not met | true error, mm: median, 90 % "
        "| contacts: median, most |",
        "|---|---|---|---|---|---|---|",
    ]
    for goal in asked.goals:
        mine = [row for row in touched if row["goal"] == goal]
        lines += _line(f"until {goal:g} mm, median ", goal, mine, stopped=True)
        for fixed in asked.fixed:
            lines += _line(f"{fixed}, spread evenly", goal, [row for row in touched if row["fixed"] == fixed])
    if touched:
        yield Table("\n".join(lines), "stopped figures")
    if posed:
        yield Table(_of_tracker(posed), "tracker figures")


def _of_tracker(found: Sequence[Row]) -> str:
    lines = [
        "| planned poses | robots | true error below quantile | quantile, mm: median | true error, mm: median, 90 % |",
        "|---|---|---|---|---|",
    ]
    for poses in POSES:
        if rows := [row for row in found if row["poses"] == poses]:
            true, high = (np.array([row[key] for row in rows]) for key in ("true", "high"))
            figures = f"{np.median(high):.3f} | {np.median(true):.3f}, {np.quantile(true, 0.9):.3f}"
            lines.append(f"| {poses} | {len(rows)} | {(true <= high).sum()} | {figures} |")
    return "\n".join(lines)


def _line(name: str, goal: float, rows: Sequence[Row], *, stopped: bool = False) -> Iterator[str]:
    if not rows:
        return
    true, counts, made = (np.array([row[key] for row in rows]) for key in ("true", "touches", "made"))
    claimed = np.array([row["ended"] == "goal" and row["verdict"] == "better" for row in rows])
    middle = f"{np.median(counts):.0f} ({counts.min()} … {counts.max()})" if stopped else ""
    claims = f"{claimed.sum()} | {(claimed & (true > goal)).sum()}" if stopped else "– | –"
    errors = f"{np.median(true):.3f}, {np.quantile(true, 0.9):.3f}"
    contacts = f"{np.median(made):.0f}, {made.max()}"
    yield f"| {name}{middle} | {len(rows)} | {(true <= goal).sum()} | {claims} | {errors} | {contacts} |"


OPTIONS = {
    "--goals": {"type": float, "nargs": "+", "default": [0.1], "help": "mm (0.1)"},
    "--fixed": {"type": int, "nargs": "*", "default": list(FIXED), "help": "numbers of touches of the fit"},
    "--tracker": {"type": int, "default": 12, "help": "robots of the tracker cell (12)"},
}
STUDY = Study(units, measure, tables, seeds=40, options=OPTIONS, writes=True)
