"""Planned rows beside today's rule: touches of simulated KR5 cells, at equal numbers and on the same seeds (1 hour).

Each robot is touched as `sphere_selfcal` plans it, evenly or `choice=optimal`; the contacts come from the simulator's
world along the planned searches, without wires: 25 touches of seeds 1 to 3 leave what campaigns over the wires left, to
0.015 mm. Workspace: RMS to the simulator's truth at 512 postures, rigid motion removed. The probability of a term
(`design_problem.PRESENT`) was chosen on seeds 101 to 104, and seeds 1 and 2 were looked at: neither judges here.
"""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Iterator
from functools import cache

import numpy as np

from cellctl.calibration import Split, fit
from cellctl.files import load_yaml
from cellctl.formats import DataSet, RobotFile, artefact_of, measurements
from procedures.steps.sphere.planning import planned_touches
from procedures.steps.sphere.touch_plans import TouchPlan
from sims.cell import read_cell
from sims.world.world import World
from tests.helpers.arms import KR5_FILE, Floats
from tests.helpers.runs import ROOT
from tests.helpers.simulated_data import best_rigid, workspace_of
from tests.helpers.steps import Context
from tests.studies._runner import Row, Study, Table, each

SPHERES = ["S1", "S2", "S3"]
CELLS = {"rigid": "sphere_cell.yaml", "flexible": "flexible_sphere_cell.yaml"}
COUNTS = {"rigid": (35, 50, 25), "flexible": (35, 50)}
SEEDS = {("flexible", 35): 12, ("flexible", 50): 12, ("rigid", 25): 20}
"""Of some, only so many robots."""

HELD_OUT, REFERENCE_EVERY = 30, 20
PROBE_MM = 0.005
"""1 σ of a contact along its search: a millisecond at 5 mm/s."""


def units(asked: Namespace) -> Iterator[Row]:
    """Each choice of each number of touches on each robot."""
    for seed in asked.seeds:
        for robot, counts in COUNTS.items():
            mine = [count for count in counts if seed < asked.first + SEEDS.get((robot, count), len(asked.seeds))]
            yield from each(robot=[robot], touches=mine, choice=["even", "optimal"], seed=[seed])


def measure(robot: str, touches: int, choice: str, seed: int) -> Row:
    """The error of the identified robot, and what the fit says of it."""
    cell = ROOT / "procedures" / "cells" / CELLS[robot]
    context = Context(robot_file=KR5_FILE, cell=load_yaml(cell))
    context.seed = seed  # type: ignore[attr-defined]
    plans = planned_touches(context, touches, HELD_OUT, SPHERES, REFERENCE_EVERY, choice)  # type: ignore[arg-type]
    world, file = World(read_cell(cell), seed), RobotFile.load(KR5_FILE)
    data = touched(world, [plan for plan in plans if plan.set == "fit"], seed)
    measured = measurements(file, data, artefact=artefact_of(context.cell, ("artefact",)))
    found = fit(measured.task, Split(np.arange(len(data.lines)), ()))
    readings = postures()
    predicted = found.identification.identified.state.model.tcp(file.joint_map().model(readings))
    true = np.array([world.true_tcp(each) for each in readings.tolist()])
    errors = np.linalg.norm(best_rigid(predicted, true).apply(predicted) - true, axis=1)
    return {
        "made": len(data.lines),
        "rms": float(np.sqrt(np.mean(errors**2))),
        "largest": float(errors.max()),
        "predicted": found.predicted_volumetric_rms,
        "model": found.model,
    }


@cache
def postures() -> Floats:
    """Of the workspace."""
    return workspace_of(RobotFile.load(KR5_FILE), 512)


def touched(world: World, plans: list[TouchPlan], seed: int) -> DataSet:
    """The contacts of planned touches; a search that meets nothing gives none."""
    rng = np.random.default_rng([seed, 5])
    rows = []
    for plan in plans:
        readings = contact(world, plan, float(rng.normal(0.0, PROBE_MM)))
        if readings is not None:
            rows.append({**{f"A{axis}": reading for axis, reading in enumerate(readings, 1)}, "sphere": plan.sphere})
    return DataSet.of_records(rows, "touches")


def contact(world: World, plan: TouchPlan, late_mm: float) -> list[float] | None:
    """Readings where the tip meets a sphere between start and end of the search, by bisection; None: nowhere."""
    start, way = np.array(plan.start), np.array(plan.end) - np.array(plan.start)
    scatter, directions = world.scatter(plan.start, 0), np.sign(way).astype(int).tolist()

    def outside(share: float) -> bool:
        links = world.links_after((start + share * way).tolist(), directions)
        return world.gap(links, scatter)[0] > 0.0

    before, after = 0.0, 1.0
    if outside(after) or not outside(before):
        return None
    while after - before > 1e-7:
        middle = (before + after) / 2.0
        before, after = (middle, after) if outside(middle) else (before, middle)
    return world.encoder((start + (after + late_mm / plan.search_mm) * way).tolist())


def tables(found: list[Row], _: Namespace) -> Iterator[Table]:
    """Medians and quartiles, and the ratio of the medians."""
    lines = [
        "| robot | touches | robots | even | optimal | ratio of medians | optimal is worse |",
        "|---|---|---|---|---|---|---|",
    ]
    for robot, counts in COUNTS.items():
        for touches in counts:
            mine = [row for row in found if (row["robot"], row["touches"]) == (robot, touches)]
            errors = {(row["choice"], row["seed"]): row["rms"] for row in mine}
            both = [seed for choice, seed in errors if choice == "optimal" and ("even", seed) in errors]
            if not both:
                continue
            even, optimal = (np.array([errors[choice, seed] for seed in both]) for choice in ("even", "optimal"))
            ratio = f"{np.median(optimal) / np.median(even):.2f} | {np.count_nonzero(optimal > even)}"
            lines.append(f"| {robot} | {touches} | {len(both)} | {_spread(even)} | {_spread(optimal)} | {ratio} |")
    yield Table("\n".join(lines), "planned touches")


def _spread(errors: Floats) -> str:
    low, middle, high = np.quantile(errors, (0.25, 0.5, 0.75))
    return f"{middle:.3f} ({low:.3f} … {high:.3f})"


STUDY = Study(units, measure, tables, seeds=40, first=11, writes=True)
