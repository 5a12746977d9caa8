"""Five robots of the tracker cell: errors before and after, ratio to the floor, frames against the truth (15 minutes).

Runs `tracker_calibration` over the wires on geometric robots and on robots with every effect of the simulated world,
and asks the simulated world what the instrument would have shown without noise. Prints Markdown tables. A study and no
test: it judges nothing. Run folders stay in `runs/studies/CODE/tracker_cell`.
"""

from __future__ import annotations

import tempfile
from argparse import Namespace
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from cellctl.journal import fold, read_journal
from cellctl.metrology.error_figures import floor_ratio
from cellctl.metrology.measured_pose import nees_range
from procedures.steps.tracker.rows import TrackerVerdict
from tests.helpers.runs import ROOT, copied_cell, finished_run
from tests.helpers.tracker import CELL, FLEXIBLE, Truth, found_frames, frame_errors, held_out, true_frames
from tests.studies._runner import ROWS, Row, Study, Table, each
from tests.studies.compensation_methods import figures

EFFECTS = "{compliance: 1, gear: 1, backlash: 1, expansion: 1, warm_up: 1, air: 1, station_drift: 1}"
CELLS = {"geometric robots": "", "robots with every effect": f"  errors: {EFFECTS}\n"}
"""Robots → lines of the cell's section `simulate:`."""

ROBOT = ROOT / "procedures" / "robots" / "kr5_r1400.yaml"
HEAD = (
    "| seed | held-out poses, mean/RMS/max before → after | predicted ÷ found RMS | in their 95 % region "
    "| floor, RMS | ratio to the floor (95 %) | targets by the table, mean/RMS/max before → after |\n"
    "|---|---|---|---|---|---|---|"
)
FRAMES = "| seed | {B}: off by mm, ° | NEES | {T}: off by mm, ° | NEES |\n|---|---|---|---|---|"


def measure(robots: str, seed: int) -> Row:
    """A campaign. nominal, identified, floor: lengths of the errors of held-out poses, mm; frames: {B} and {T}, each
    with its error of place (mm), of direction (deg), and NEES. Raises RuntimeError where it comes to no verdict.
    """
    with tempfile.TemporaryDirectory() as folder:
        lines = CELLS[robots]
        cell = copied_cell(CELL, Path(folder), lines, name="every_effect.yaml") if lines else CELL
        runs = ROWS.resolve() / "tracker_cell" / f"{cell.stem}-{seed}"
        run = finished_run(runs, "tracker_calibration", "--cell", cell, "--seed", str(seed))
        journal, truth = fold(read_journal(run)), Truth(cell, seed)
        geometry_alone = Truth(cell, seed, switched_off=FLEXIBLE)
        found, verdict = held_out(run, journal, truth), journal.recorded(TrackerVerdict)[-1]
        frames = frame_errors(found_frames(journal, ROBOT), true_frames(journal, ROBOT, geometry_alone))
    assert verdict.held_out
    assert verdict.held_out.predicted
    assert verdict.targets
    assert verdict.model
    return {
        "nominal": found.nominal,
        "identified": found.identified,
        "floor": found.floor,
        "predicted": verdict.held_out.predicted,
        "coverage": verdict.model["coverage_95"],
        "targets": [[end.mean, end.rms, end.max] for end in (verdict.targets.before, verdict.targets.after)],
        "frames": dict(frames),
    }


def tables(found: list[Row], _: Namespace) -> Iterator[Table]:
    """Both tables of each kind of robots."""
    for robots in CELLS:
        if all_of := [row for row in found if row["robots"] == robots]:
            yield Table("\n".join([f"\n{robots}\n\n{HEAD}", *map(line, all_of)]))
            yield Table("\n".join([f"\nframes, {robots}\n\n{FRAMES}", *map(frames_line, all_of)]))
            all_nees = nees_range([nees for row in all_of for _, _, nees in row["frames"].values()], 6)
            right = f"{all_nees.low:.2f} … {all_nees.high:.2f}"
            yield Table(f"\nmean NEES {all_nees.mean:.2f}; 99 % of right covariances: {right}")


def line(row: Row) -> str:
    """A campaign's line of the table."""
    nominal, identified, floor = (np.array(row[name]) for name in ("nominal", "identified", "floor"))
    ratio = floor_ratio(identified, floor)
    targets = " → ".join("/".join(f"{value:.3f}" for value in end) for end in row["targets"])
    return (
        f"| {row['seed']} | {figures(nominal)} → {figures(identified)} "
        f"| {row['predicted'] / ratio.rms_mm:.2f} | {100 * row['coverage']:.0f} % "
        f"| {ratio.floor_mm:.3f} | {ratio.ratio:.2f} ({ratio.low:.2f}…{ratio.high:.2f}) | {targets} |"
    )


def frames_line(row: Row) -> str:
    """A campaign's line of the table of frames."""
    cells = " | ".join(f"{mm:.3f}, {deg:.4f} | {nees:.2f}" for mm, deg, nees in row["frames"].values())
    return f"| {row['seed']} | {cells} |"


STUDY = Study(lambda asked: each(robots=CELLS, seed=asked.seeds), measure, tables, seeds=5)
