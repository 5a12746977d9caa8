"""The test by ISO 9283 and the daily check over the wires: GeoCOM, Modbus, CAN, EthernetKRL, all in lockstep."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cellctl.journal import Journal, Recorded, RunStarted, RunState, SourceFile, StateChanged, fold, read_journal
from cellctl.operations.replay import Agreement, replay_run
from procedures.steps.daily.rows import DailyPointsRow, DailyVerdict, DayPoints
from procedures.steps.iso9283.rows import IsoVerdict, RegistrationRow
from tests.helpers.runs import cellctl
from tests.helpers.tracker import cell_of

pytestmark = pytest.mark.campaign

QUICK = {"warm_up_minutes": 0.05, "warm_up_limit": 2, "samples": 2, "transfer_speed": 50}
DAILY = {"samples": 2, "transfer_speed": 50}


def run(
    procedure: str, runs: Path, settings: dict[str, Any], *words: str | Path, simulate: str = ""
) -> tuple[int, Path, RunState]:
    """Exit code, folder and journal of a run in a quick cell with these lines in its `simulate:` section."""
    given = [f"--set={name}={value}" for name, value in settings.items()]
    result = runs / "result.json"
    runs.mkdir(exist_ok=True)
    cell = cell_of(runs, simulate)
    done = cellctl("run", procedure, *given, *words, "--cell", cell, "--runs", runs, "--json", result)
    assert result.exists(), done.stderr
    folder = runs / json.loads(result.read_text())["run"]
    result.unlink()
    return done.returncode, folder, fold(read_journal(folder))


def remembered(runs: Path) -> tuple[str, str]:
    """The options by which a simulated cell goes on where the run before ended."""
    return "--simulator=--state", f"--simulator={runs / 'cell.json'}"


def earlier_runs(runs: Path, day: DayPoints, noise_mm: float) -> None:
    """20 earlier runs with new noise: the simulated cell repeats its noise from run to run."""
    rng, source = np.random.default_rng(7), SourceFile("x.yaml", "", "")
    runs.mkdir(exist_ok=True)
    for number in range(1, 21):
        noisy = [
            tuple(map(tuple, (np.array(places) + rng.normal(0.0, noise_mm, np.shape(places))).tolist()))
            for places in (day.points, day.nests)
        ]
        began, name = f"2026-01-{number:02d}T08:00:00Z", f"daily_check-{number}"
        with Journal.create(runs / name, lambda: 0) as journal:
            section = DailyVerdict.SECTION
            journal.append(
                RunStarted(source, source, {}, 1, "lockstep", "me", began, "", {}, name=name, section=section)
            )
            there = DayPoints(**{**vars(day), "points": noisy[0], "nests": noisy[1]})
            journal.append(Recorded.of(DailyPointsRow(day=there), "", 1))
            journal.append(StateChanged("running", "finished", ""))


@pytest.fixture(scope="module")
def first_day(tmp_path_factory: pytest.TempPathFactory) -> tuple[int, Path, RunState]:
    runs = tmp_path_factory.mktemp("daily") / "runs"
    return run("daily_check", runs, DAILY, *remembered(runs))


@pytest.mark.long
def test_the_first_daily_check_starts_a_baseline_and_is_replayed(first_day: tuple[int, Path, RunState]) -> None:
    code, folder, state = first_day
    assert code == 0
    found = state.last(DailyVerdict)
    assert found is not None
    assert found.sentence.startswith("Baseline 'first', run 1 of 20")
    replay = replay_run(folder)
    assert replay.agreement is Agreement.EXACT
    assert "daily.judge" in {step.do for step in replay.steps}


@pytest.mark.long
def test_a_daily_check_after_20_runs_finds_other_joint_zeros(
    first_day: tuple[int, Path, RunState], tmp_path: Path
) -> None:
    runs = tmp_path / "runs"
    earlier_runs(runs, first_day[2].recorded(DailyPointsRow)[0].day, 0.1)
    code, folder, state = run("daily_check", runs, DAILY, simulate="  errors: {joint_zero: 4}\n")
    found = state.last(DailyVerdict)
    assert found is not None
    assert (code, found.verdict) == (1, "measure again"), found.lines
    assert found.daily.baseline_runs == 20
    assert replay_run(folder).agreement is Agreement.EXACT


@pytest.mark.long
def test_a_simulated_cell_that_remembers_the_day_before_has_new_noise_and_is_in_control(
    first_day: tuple[int, Path, RunState], tmp_path: Path
) -> None:
    before = first_day[2].recorded(DailyPointsRow)[0].day
    earlier_runs(tmp_path / "runs", before, 0.1)
    code, _, state = run("daily_check", tmp_path / "runs", DAILY, *remembered(first_day[1].parent))
    found, today = state.last(DailyVerdict), state.recorded(DailyPointsRow)[0].day
    assert found is not None
    assert (code, found.verdict) == (0, "in control"), found.lines
    assert 0.01 < np.abs(np.subtract(today.points, before.points)).max() < 1.0


@pytest.mark.long
def test_a_short_test_by_iso_9283_measures_the_robot_by_nominal_joints(tmp_path: Path) -> None:
    settings = {**QUICK, "samples": 1, "cycles": 2, "registration_poses": 10, "directions": "false"}
    code, folder, state = run("iso9283", tmp_path / "runs", settings)
    assert code == 0
    found, registration = state.last(IsoVerdict), state.last(RegistrationRow)
    assert found is not None
    assert registration is not None
    assert found.verdict == "measured"
    assert all(0.1 < each.accuracy < 10.0 for each in found.iso9283.before.points)
    assert (registration.by, registration.poses) == ("nominal", 10)
    assert "iso-scatter" in (folder / "report.html").read_text()
    assert replay_run(folder).agreement is Agreement.EXACT


@pytest.mark.long
def test_the_table_made_of_a_calibration_makes_pose_accuracy_better(tmp_path: Path) -> None:
    runs = tmp_path / "runs"
    few = {**QUICK, "poses_fit": 30, "poses_test": 8, "monuments_every": 40, "turn_points": 5, "model": "geometry"}
    code, calibration, _ = run("tracker_calibration", runs, few)
    assert code == 0
    # the orientation, by three reflectors, is in the short test above
    settings = {**QUICK, "cycles": 3, "registration_poses": 12, "model_from": calibration.name}
    settings |= {"reflectors": 1, "transfer_speed": 100}
    code, folder, state = run("iso9283", runs, settings)
    found = state.last(IsoVerdict)
    assert found is not None
    assert (code, found.verdict) == (0, "better"), found.sentence
    assert found.iso9283.after is not None
    tests = found.iso9283.before, found.iso9283.after
    before, after = (np.mean([each.accuracy for each in test.points]) for test in tests)
    assert after < 0.2 * before
    assert len(found.iso9283.after.variation) == 3
    assert replay_run(folder).agreement is Agreement.EXACT
