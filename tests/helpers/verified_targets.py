"""Runs of `compensate_and_verify` on a simulated cell, and their floor: errors of a predictor that knows the truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import final

import numpy as np

from cellctl.journal import RunState, fold, read_journal
from cellctl.kinematics import Floats
from cellctl.metrology.error_figures import FloorRatio, floor_ratio
from procedures.steps.tracker._judging import Targets
from procedures.steps.tracker.rows import CompensatedRow, TargetsRow
from tests.helpers.runs import ROOT, finished_run
from tests.helpers.tracker_truth import Truth

HEAVY_CELL = ROOT / "procedures" / "papers" / "cells" / "heavy_robot_cell.yaml"
CALIBRATION = ROOT / "procedures" / "papers" / "configuration_space_kriging.yaml"
TARGETS = "../targets/heavy_robot.csv"
"""The poses of the paper's task workspace; its set `test` is in no fit."""

MOST_MM, OVER_FLOOR = 0.15, 1.15
"""Demands on iterated methods: largest error, and RMS divided by the floor's."""


@final
@dataclass(frozen=True, eq=False)
class Verified:
    """3-D errors (N,), mm, of N targets: before, after, and of a predictor that knows the truth, on the rows after."""

    before: Floats
    after: Floats
    floor: Floats
    correction_deg: float
    left_out: int

    @classmethod
    def of(cls, run: Path, cell: Path, seed: int) -> Verified:
        """Of the run in a folder, on the simulated `cell` of `seed`."""
        journal: RunState = fold(read_journal(run))
        targets, made = Targets.of(journal), journal.recorded(TargetsRow)[-1]
        rows = {row.number: row for row in journal.recorded(CompensatedRow)}
        visits = [rows[int(number)] for number in targets.numbers]
        measured = np.array([row.point.xyz for row in visits])
        true = Truth(cell, seed).places(visits, shown=True)
        floor = np.linalg.norm(measured - true, axis=1)
        return cls(*targets.lengths, floor, made.max_correction_deg, len(made.left_out))

    @classmethod
    def pooled(cls, parts: Sequence[Verified]) -> Verified:
        """The targets of several runs together."""
        columns = (np.concatenate([getattr(one, name) for one in parts]) for name in ("before", "after", "floor"))
        return cls(*columns, max(one.correction_deg for one in parts), sum(one.left_out for one in parts))

    @property
    def ratio(self) -> FloorRatio:
        """RMS after, divided by the floor's."""
        return floor_ratio(self.after, self.floor)


def calibrated(seed: int, folder: Path) -> Path:
    """The run folder of a calibration of the heavy-robot cell from the paper's 160 poses; an earlier one serves."""
    return finished_run(folder / f"calibrated-{seed}", CALIBRATION, "--seed", str(seed), "--set", "poses_test=6")


def verified(seed: int, model_run: Path, folder: Path, method: str, passes: int = 0, targets: int = 80) -> Path:
    """The run folder of `compensate_and_verify` by `method`; an earlier one serves. passes: 0: until it converges."""
    settings = {
        "model_run": model_run,
        "target_file": TARGETS,
        "targets": targets,
        "method": method,
        "passes": passes,
        "two_face_limit": 0.2,
    }
    given = [part for name, value in settings.items() for part in ("--set", f"{name}={value}")]
    runs = folder / f"{method}-{passes or 'iterated'}-{seed}"
    return finished_run(runs, "compensate_and_verify", "--cell", HEAVY_CELL, "--seed", str(seed), *given)
