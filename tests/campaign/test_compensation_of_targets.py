"""Two iterated methods on the heavy-robot cell over the wires: held-out targets come near to the floor.

A quarter of the 80 targets of `compensation_methods`, whose figures are in docs/results/campaigns.md.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from cellctl.journal import fold, read_journal
from procedures.steps.tracker.rows import CorrectionEndRow, CorrectionLogRow, TrackerVerdict
from tests.helpers.runs import cellctl, only_run, quick_cell
from tests.helpers.tracker import HEAVY_CELL, MOST_MM, OVER_FLOOR, TARGETS, Verified, calibrated, verified

pytestmark = [pytest.mark.campaign, pytest.mark.long]

SEED, N_TARGETS = 1, 20


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("methods")


@pytest.fixture(scope="module")
def cell(folder: Path) -> Path:
    return quick_cell(folder, shipped=HEAVY_CELL)


@pytest.fixture(scope="module")
def model_run(folder: Path, cell: Path) -> Path:
    """A calibration from the paper's 160 poses."""
    return calibrated(SEED, folder, cell)


@pytest.mark.parametrize("method", ["pseudo-target", "cyclic-search"])
def test_an_iterated_method_brings_targets_of_the_heavy_robot_near_the_floor(
    folder: Path, cell: Path, model_run: Path, method: str
) -> None:
    run = verified(SEED, model_run, folder, method, targets=N_TARGETS, cell=cell)
    found = Verified.of(run, cell, SEED)
    assert len(found.after) == N_TARGETS
    assert found.before.mean() > 0.5
    assert found.after.max() <= MOST_MM
    assert found.ratio.ratio <= OVER_FLOOR


def test_on_line_correction_brings_held_out_targets_of_the_heavy_robot_within_015_mm(
    tmp_path: Path, cell: Path, model_run: Path
) -> None:
    """12 of the 80 targets: docs/results/campaigns.md has the figures of all."""
    settings = {"model_run": model_run, "target_file": TARGETS, "targets": 12, "two_face_limit": 0.2}
    given: list[str | Path] = [part for name, value in settings.items() for part in ("--set", f"{name}={value}")]
    given += ["--cell", cell, "--seed", str(SEED), "--runs", tmp_path / "runs"]
    done = cellctl("run", "online_correction", *given)
    assert done.returncode == 0, done.stderr
    journal = fold(read_journal(only_run(tmp_path / "runs")))
    verdict = journal.recorded(TrackerVerdict)[-1]
    assert verdict.targets.n == 12
    assert verdict.targets.before.mean > 0.5
    assert verdict.targets.after.max <= MOST_MM
    assert all(row.late == row.lost == 0 for row in journal.recorded(CorrectionEndRow))
    assert len(journal.recorded(CorrectionLogRow)) == 12
