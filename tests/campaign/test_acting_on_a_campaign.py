"""A campaign on the simulated cell, acted on from other processes: paused, continued, and ended by SIGTERM."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from cellctl.journal import OperatorAction, StateChanged, fold, read_journal
from tests.helpers.runs import PATIENCE_S, ROOT, UNHURRIED, cell_with, cellctl, child, only_run, touches_procedure

pytestmark = pytest.mark.campaign


@pytest.mark.long
def test_a_campaign_is_paused_continued_and_ended_by_sigterm_as_by_ctrl_c(tmp_path: Path) -> None:
    procedure, cell = touches_procedure(tmp_path, fit=30), cell_with(tmp_path, UNHURRIED)
    runs = tmp_path / "runs"
    command = [sys.executable, "-m", "cellctl", "run", str(procedure), "--cell", str(cell), "--runs", str(runs)]
    with child(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as running:
        assert running.stdout is not None
        while "planned" not in running.stdout.readline():
            assert running.poll() is None
        for verb in ("pause", "continue"):
            done = cellctl(verb, "--runs", runs)
            assert done.returncode == 0, done.stderr
        os.kill(running.pid, signal.SIGTERM)
        running.communicate(timeout=PATIENCE_S)
    assert running.returncode == 130
    entries = list(read_journal(only_run(runs)))
    assert fold(entries).state == "aborted"
    events = [entry.event for entry in entries]
    actions = [event for event in events if isinstance(event, OperatorAction)]
    assert [(action.action, action.via, action.refused) for action in actions] == [
        ("pause", "cli", ""),
        ("resume", "cli", ""),
        ("abort", "SIGTERM", ""),
    ]
    assert "cleaning" in [event.after for event in events if isinstance(event, StateChanged)]
