"""A crash is a pause: killed at any instant and resumed, no touch is lost or done twice, and nothing moves unasked."""

from __future__ import annotations

import random
import signal
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path
from typing import Any

import pytest

from cellctl.files import sha256_of
from cellctl.journal import (
    Journal,
    Outcome,
    RunStarted,
    RunState,
    SourceFile,
    StepEnded,
    StepStarted,
    fold,
    read_journal,
)
from cellctl.operations.launch import code_hash, sources
from tests.helpers.runs import PATIENCE_S, ROOT, cell_with, cellctl, touches_procedure

pytestmark = pytest.mark.campaign

KILLS = 25  # in each of two tests
THIRD_OR_LATER = {f"points[{index}].touch" for index in range(2, 6)}


def start(arguments: list[str]) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "cellctl", "run", *arguments]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, cwd=ROOT)


def journal_of(runs: Path) -> Path | None:
    return next(runs.glob("*/journal.sqlite"), None)


def killed_after(process: subprocess.Popen[str], seconds: float) -> bool:
    """Whether it still ran after that time, and was killed (-9)."""
    try:
        process.communicate(timeout=seconds)
    except subprocess.TimeoutExpired:
        process.send_signal(signal.SIGKILL)
        process.communicate(timeout=PATIENCE_S)
        return True
    return False


@pytest.mark.long
@pytest.mark.parametrize("seed", [1, 2])
def test_fifty_random_kills_lose_and_repeat_nothing(seed: int, tmp_path: Path) -> None:
    chance = random.Random(seed)
    procedure, cell = str(touches_procedure(tmp_path)), str(cell_with(tmp_path))
    kills, campaign = 0, 0
    while kills < KILLS:
        campaign += 1
        runs = tmp_path / f"runs{campaign}"
        common = [procedure, "--cell", cell, "--runs", str(runs)]
        process = start(common)
        while killed_after(process, chance.uniform(0.5, 3.5)) and kills < KILLS:
            kills += 1
            journal = journal_of(runs)
            if journal is None or fold(read_journal(journal)).started is None:
                break
            process = start([*common, "--resume", journal.parent.name, *_acknowledged(journal)])
        journal = journal_of(runs)
        if journal is None or fold(read_journal(journal)).started is None:
            continue
        _finish(common, journal)
        _nothing_lost_or_doubled(journal)


@pytest.mark.long
def test_a_cut_off_touch_is_not_repeated_before_somebody_has_looked(tmp_path: Path) -> None:
    procedure, cell = str(touches_procedure(tmp_path)), str(cell_with(tmp_path))
    common = [procedure, "--cell", cell, "--runs", str(tmp_path / "runs")]
    journal = _killed_in_a_touch(common, tmp_path / "runs")
    before = list(read_journal(journal))
    refused = cellctl("run", *common, "--resume", journal.parent.name)
    assert refused.returncode == 4
    assert "points[" in refused.stderr
    assert "--acknowledge" in refused.stderr
    assert list(read_journal(journal)) == before, "nothing was written, nothing moved"
    done = cellctl("run", *common, "--resume", journal.parent.name, "--acknowledge")
    assert done.returncode == 0, done.stderr
    _nothing_lost_or_doubled(journal)


@pytest.mark.long
@pytest.mark.parametrize("what", ["procedure", "cell"])
def test_a_run_of_which_procedure_or_cell_has_changed_is_not_resumed(what: str, tmp_path: Path) -> None:
    files = {"procedure": touches_procedure(tmp_path), "cell": cell_with(tmp_path)}
    common = [str(files["procedure"]), "--cell", str(files["cell"]), "--runs", str(tmp_path / "runs")]
    journal = _killed_in_a_touch(common, tmp_path / "runs")
    files[what].write_text(files[what].read_text() + "\n# changed\n")
    refused = cellctl("run", *common, "--resume", journal.parent.name, "--acknowledge")
    assert refused.returncode == 2
    assert f"the {what}" in refused.stderr
    assert "has changed since" in refused.stderr


@pytest.mark.long
def test_a_finished_run_is_not_resumed(tmp_path: Path) -> None:
    common = [str(touches_procedure(tmp_path)), "--cell", str(cell_with(tmp_path)), "--runs", str(tmp_path / "runs")]
    assert cellctl("run", *common).returncode == 0
    journal = journal_of(tmp_path / "runs")
    assert journal is not None
    refused = cellctl("run", *common, "--resume", journal.parent.name)
    assert refused.returncode == 2
    assert "finished" in refused.stderr


@pytest.mark.parametrize("step", ["push", "points[3].touch"])
def test_a_push_or_a_move_in_flight_asks_for_a_person(step: str, tmp_path: Path) -> None:
    common = _journal_by_hand(tmp_path, code_hash(), StepStarted(step, 1, moves=True))
    refused = cellctl("run", *common)
    assert refused.returncode == 4
    assert step in refused.stderr


def test_a_run_made_by_other_code_is_not_resumed(tmp_path: Path) -> None:
    refused = cellctl("run", *_journal_by_hand(tmp_path, "0" * 64, StepStarted("plan", 1, moves=False)))
    assert refused.returncode == 2
    assert "the code of cellctl" in refused.stderr


def test_a_run_made_by_other_code_names_the_files_that_differ(tmp_path: Path) -> None:
    before = {**sources(), "drivers/gone.py": "0" * 64, "cellctl/__main__.py": "0" * 64}
    last = StepStarted("plan", 1, moves=False)
    refused = cellctl("run", *_journal_by_hand(tmp_path, "0" * 64, last, sources=before))
    assert refused.returncode == 2
    assert "has changed since: cellctl/__main__.py, drivers/gone.py\n" in refused.stderr


def test_a_run_with_another_robot_file_is_not_resumed(tmp_path: Path) -> None:
    robot, last = SourceFile("kr5.yaml", "another", sha256_of("another")), StepStarted("plan", 1, moves=False)
    refused = cellctl("run", *_journal_by_hand(tmp_path, code_hash(), last, robot=robot))
    assert refused.returncode == 2
    assert "the robot file kr5.yaml has changed since" in refused.stderr


def _journal_by_hand(folder: Path, code: str, last: StepStarted, **more: Any) -> list[str]:
    """Arguments that resume a run whose journal says this."""
    procedure, cell = touches_procedure(folder), cell_with(folder)
    files = [SourceFile(str(path), path.read_text(), sha256_of(path.read_text())) for path in (procedure, cell)]
    with Journal.create(folder / "runs" / "made", lambda: 0) as journal:
        journal.append(RunStarted(*files, {}, 1, "lockstep", "me", "2026-11-21T00:00:00Z", code, {}, **more))
        journal.append(last)
    return [str(procedure), "--cell", str(cell), "--runs", str(folder / "runs"), "--resume", "made"]


def _acknowledged(journal: Path) -> list[str]:
    state = fold(read_journal(journal))
    return ["--acknowledge"] if state.uncertain or state.state == "uncertain" else []


def _finish(common: list[str], journal: Path) -> None:
    if fold(read_journal(journal)).state == "finished":
        return
    done = cellctl("run", *common, "--resume", journal.parent.name, *_acknowledged(journal))
    assert done.returncode == 0, done.stderr


def _nothing_lost_or_doubled(journal: Path) -> None:
    entries = list(read_journal(journal))
    state: RunState = fold(entries)
    assert state.state == "finished"
    assert sorted(row["number"] for row in state.data_of("touch")) == list(range(6))
    done = Counter(
        entry.event.step
        for entry in entries
        if isinstance(entry.event, StepEnded) and entry.event.outcome is Outcome.DONE
    )
    assert {step: count for step, count in done.items() if count > 1 and not step.startswith("cleanup")} == {}


def _killed_in_a_touch(common: list[str], runs: Path) -> Path:
    """A run killed in its third touch or a later one: its journal."""
    process = start(common)
    while process.poll() is None:
        if _in_a_touch(runs):
            process.send_signal(signal.SIGSTOP)  # or it might be between two touches by now
            if _in_a_touch(runs):
                process.send_signal(signal.SIGKILL)
                process.communicate(timeout=PATIENCE_S)
                journal = journal_of(runs)
                assert journal is not None
                return journal
            process.send_signal(signal.SIGCONT)
        time.sleep(0.02)  # noqa: TID251 - another process, in wall time
    raise AssertionError("the campaign did not get to its third touch")


def _in_a_touch(runs: Path) -> bool:
    """Whether the third touch, or a later one, is under way."""
    journal = journal_of(runs)
    state = fold(read_journal(journal)) if journal else RunState()
    return any(step.step in THIRD_OR_LATER for step in state.in_flight)
