"""Campaigns that stop at a goal: is it met in truth, and what do they save against a fixed number of touches?

KR5 robots of the simulated sphere cell, three certified spheres. The steps `sphere.plan`, `sphere.next_batch` and
`sphere.identify` of `sphere_selfcal` plan, decide and judge; the touches are those of the simulated world, without the
wires. Truth: 3-D RMS over the joint ranges for which the goal is, the best rigid motion removed. Fixed: as many touches
for all robots, spread evenly, as `sphere_selfcal` makes them without a goal.
"""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from cellctl.formats import ModelFile
from cellctl.records import BatchRow
from procedures.steps.sphere.rows import ReferenceRow, SphereVerdict, TouchRow
from tests.helpers.simulated_data import workspace_of
from tests.helpers.touch_campaign import SPHERES, TouchCampaign
from tests.studies._runner import Row, Study, Table, each

MOST, HELD_OUT, BATCH, EVERY, POSTURES = 150, 30, 10, 20, 256
FIXED = (50, 65, 80)


def measure(seed: int, goal: float, fixed: int) -> Row:
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


def tables(found: list[Row], asked: Namespace) -> Iterator[Table]:
    """A line for each goal, and for each fixed number by each goal."""
    lines = [
        "| touches of the fit | robots | met in truth | claimed | claimed, and not met | true error, mm: median, 90 % "
        "| contacts: median, most |",
        "|---|---|---|---|---|---|---|",
    ]
    for goal in asked.goals:
        lines += _line(f"until {goal:g} mm, median ", goal, [row for row in found if row["goal"] == goal], stopped=True)
        for fixed in asked.fixed:
            lines += _line(f"{fixed}, spread evenly", goal, [row for row in found if row["fixed"] == fixed])
    yield Table("\n".join(lines), "stopped figures")


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
}
STUDY = Study(units, measure, tables, seeds=40, options=OPTIONS, writes=True)
