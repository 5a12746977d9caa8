"""Five robots of the tracker cell: errors before and after, ratio to the floor, frames against the truth (15 minutes).

    uv run python tests/studies/tracker_cell.py [--seeds 5] [--keep FOLDER]

Runs `tracker_calibration` over the wires on geometric robots and on robots with every effect of the simulated world,
and asks the simulated world what the instrument would have shown without noise. Prints Markdown tables. A study and no
test: it judges nothing.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "helpers"))

from cell_runs import ROOT, cellctl
from tracker_runs import CELL, cell_of
from tracker_truth import FLEXIBLE, Truth, found_frames, frame_errors, held_out, true_frames

from cellctl.journal import RunState, fold, read_journal
from cellctl.kinematics import Floats
from cellctl.metrology.error_figures import floor_ratio
from cellctl.metrology.measured_pose import nees_range
from procedures.steps.tracker.rows import TrackerVerdict

EFFECTS = "{compliance: 1, gear: 1, backlash: 1, expansion: 1, warm_up: 1, air: 1, station_drift: 1}"
ROBOT = ROOT / "procedures" / "robots" / "kr5_r1400.yaml"
HEAD = (
    "| seed | held-out poses, mean/RMS/max before → after | predicted ÷ found RMS | in their 95 % region "
    "| floor, RMS | ratio to the floor (95 %) | targets by the table, mean/RMS/max before → after |\n"
    "|---|---|---|---|---|---|---|"
)
FRAMES = "| seed | {B}: off by mm, ° | NEES | {T}: off by mm, ° | NEES |\n|---|---|---|---|---|"


@dataclass(frozen=True)
class Frames:
    """{B} and {T} of one campaign: error of place (mm), of direction (deg), NEES."""

    errors: dict[str, tuple[float, float, float]]

    def row(self, seed: int) -> str:
        cells = " | ".join(f"{mm:.3f}, {deg:.4f} | {nees:.2f}" for mm, deg, nees in self.errors.values())
        return f"| {seed} | {cells} |"


def figures(errors: Floats) -> str:
    """Mean/RMS/max of lengths, mm."""
    return f"{errors.mean():.3f}/{np.sqrt(np.mean(errors**2)):.3f}/{errors.max():.3f}"


def row(seed: int, run: Path, journal: RunState, truth: Truth) -> str:
    """A campaign's line of the table."""
    found, verdict = held_out(run, journal, truth), journal.recorded(TrackerVerdict)[-1]
    ratio = floor_ratio(found.identified, found.floor)
    assert verdict.held_out
    assert verdict.held_out.predicted
    assert verdict.targets
    assert verdict.model
    ends = (verdict.targets.before, verdict.targets.after)
    targets = " → ".join(f"{end.mean:.3f}/{end.rms:.3f}/{end.max:.3f}" for end in ends)
    return (
        f"| {seed} | {figures(found.nominal)} → {figures(found.identified)} "
        f"| {verdict.held_out.predicted / ratio.rms_mm:.2f} | {100 * verdict.model['coverage_95']:.0f} % "
        f"| {ratio.floor_mm:.3f} | {ratio.ratio:.2f} ({ratio.low:.2f}…{ratio.high:.2f}) | {targets} |"
    )


def campaign(cell: Path, seed: int, folder: Path) -> Path:
    """The run folder; an earlier one of this seed serves. Raises RuntimeError where it does not come to a verdict."""
    runs = folder / f"{cell.stem}-{seed}"
    if not runs.exists():
        told = cellctl("run", "tracker_calibration", "--cell", cell, "--seed", str(seed), "--runs", runs)
        if told.returncode:
            raise RuntimeError(f"seed {seed}: {told.stderr}")
    return next(runs.glob("*/journal.sqlite")).parent


def main() -> int:
    """Run, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--keep", type=Path, help="folder for the run folders")
    asked = parser.parse_args()
    folder = asked.keep or Path(tempfile.mkdtemp())
    folder.mkdir(parents=True, exist_ok=True)
    flexible = cell_of(folder, f"  errors: {EFFECTS}\n", "every_effect.yaml")
    for title, cell in (("geometric robots", CELL), ("robots with every effect", flexible)):
        print(f"\n{title}\n\n{HEAD}", flush=True)
        frames = []
        for seed in range(1, asked.seeds + 1):
            run = campaign(cell, seed, folder)
            journal = fold(read_journal(run))
            print(row(seed, run, journal, Truth(cell, seed)), flush=True)
            geometry_alone = Truth(cell, seed, switched_off=FLEXIBLE)
            errors = frame_errors(found_frames(journal, ROBOT), true_frames(journal, ROBOT, geometry_alone))
            frames.append(Frames(dict(errors)))
        print(f"\nframes, {title}\n\n{FRAMES}")
        print("\n".join(each.row(seed) for seed, each in enumerate(frames, 1)))
        all_nees = nees_range([nees for each in frames for _, _, nees in each.errors.values()], 6)
        print(f"\nmean NEES {all_nees.mean:.2f}; 99 % of right covariances: {all_nees.low:.2f} … {all_nees.high:.2f}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
