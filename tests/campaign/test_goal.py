"""A campaign with a goal over the wires: killed in a batch and resumed it stops as it would have, and replays equal."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from cellctl.formats import ModelFile
from cellctl.journal import JournalError, RunState, fold, read_journal
from cellctl.records import BatchRow
from tests.helpers.reports import Page
from tests.helpers.runs import CELL, FASTEST, PATIENCE_S, ROOT, SELFCAL, cellctl, only_run, quick_cell
from tests.helpers.simulated_data import volumetric_errors

pytestmark = [pytest.mark.campaign, pytest.mark.long]

SEED = 2
GOAL = ("goal=0.14", "touches_test=20", "standoff_targets=10", *FASTEST)


def settings(folder: Path, *more: str) -> list[str]:
    """Of a run in a quick cell, which is written into `folder`."""
    words = {setting.partition("=")[0]: setting for setting in (*GOAL, *more)}
    return ["--cell", str(quick_cell(folder)), *(f"--set={setting}" for setting in words.values())]


def state_of(runs: Path) -> RunState:
    try:
        return fold(read_journal(only_run(runs)))
    except (JournalError, ValueError):
        return RunState()


def in_second_batch(state: RunState) -> bool:
    """Whether a batch is planned, and two touches of it are made."""
    curve = state.recorded(BatchRow)
    return bool(curve) and len([row for row in state.data_of("touch") if row["set"] == "fit"]) >= curve[0].rows + 2


@pytest.fixture(scope="module")
def stopped(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The run folder of a campaign that was killed (-9) within a batch, and resumed."""
    runs = tmp_path_factory.mktemp("stopped") / "runs"
    common = [str(SELFCAL), "--seed", str(SEED), "--runs", str(runs), *settings(runs.parent)]
    command = [sys.executable, "-m", "cellctl", "run", *common]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, cwd=ROOT)
    until = time.monotonic() + PATIENCE_S
    while not in_second_batch(state_of(runs)):
        assert process.poll() is None, process.communicate()[1]
        assert time.monotonic() < until
        time.sleep(1.0)  # noqa: TID251 - another process, in wall time
    process.send_signal(signal.SIGKILL)
    process.communicate(timeout=PATIENCE_S)
    common = [each for each in common if each not in ("--seed", str(SEED))]
    done = cellctl("run", *common, "--resume", only_run(runs).name, "--acknowledge")
    assert done.returncode == 0, done.stderr
    assert "Goal of 0.14 mm met" in done.stdout
    return only_run(runs)


def test_it_stops_early_and_the_robot_meets_the_goal(stopped: Path, tmp_path: Path) -> None:
    state = fold(read_journal(stopped))
    curve = state.recorded(BatchRow)
    assert [row.ended for row in curve] == [*[""] * (len(curve) - 1), "goal"]
    of_fit = [row["number"] for row in state.data_of("touch") if row["set"] == "fit"]
    assert len(of_fit) == len({*of_fit}) == curve[-1].rows < 80
    assert sum(row["set"] == "test" for row in state.data_of("touch")) == 20
    model = ModelFile.load(stopped / "model.json")
    assert volumetric_errors(model, CELL, SEED, tmp_path).mean() < 0.14


def test_its_replay_decides_the_same(stopped: Path) -> None:
    done = cellctl("replay", stopped)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "next_batch" in done.stdout or "batches[" in done.stdout or "equal" in done.stdout


def test_the_report_has_the_curve_and_the_end(stopped: Path) -> None:
    text = (stopped / "report.html").read_text().partition('<section id="batches">')[2].partition("</section>")[0]
    page = Page(text).text
    assert "the goal is met" in page
    assert "The goal is met" in page
    assert "<svg" in text
    for row in fold(read_journal(stopped)).recorded(BatchRow):
        assert f"{row.high_mm:.3f}" in page


@pytest.mark.parametrize(("setting", "ended"), [("least_gain=50", "gain"), ("time_most=1", "time")])
def test_it_ends_before_the_goal_and_does_not_end_well(setting: str, ended: str, tmp_path: Path) -> None:
    runs, result = tmp_path / "runs", tmp_path / "result.json"
    words = settings(tmp_path, "goal=0.01", "touches_test=8", "standoff_targets=3", setting)
    done = cellctl("run", SELFCAL, "--seed", str(SEED), "--runs", runs, "--json", result, *words)
    assert done.returncode == 1, done.stderr
    found = json.loads(result.read_text())
    assert found["verdict"] in ("not met", "no better")  # three stand-offs seldom prove a gain
    assert found["model"]["goal"]["ended"] == ended
    assert not found["model"]["goal"]["met"]
    assert fold(read_journal(only_run(runs))).recorded(BatchRow)[-1].ended == ended
