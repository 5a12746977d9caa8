"""In lockstep, the same seed gives the same bytes: on an idle machine, on a busy one, over slow wires."""

import os
import subprocess
import sys
from dataclasses import replace

import pytest

from cellctl.journal import read_journal
from tests.helpers.runs import CELL, PATIENCE_S, ROOT, only_run, touches_procedure


def _events(folder, run, **environment):
    """What the journal of a run holds, times of the cell included; the calendar left out."""
    command = [sys.executable, "-m", "cellctl", "run", str(touches_procedure(folder)), "--cell", str(CELL)]
    done = subprocess.run(
        [*command, "--runs", str(folder / run)],
        env={**os.environ, **environment},
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    _, *later = read_journal(only_run(folder / run))
    *events, (ended_ns, ended) = ((entry.time_ns, entry.event) for entry in later)
    return [*events, (ended_ns, replace(ended, calendar=""))]


@pytest.mark.long
@pytest.mark.campaign
def test_a_campaign_over_wires_that_delay_everything_is_the_same_to_the_nanosecond(tmp_path):
    quick = _events(tmp_path, "quick")
    slow_wires = str(ROOT / "tests" / "helpers" / "slow_wires")
    slow = _events(tmp_path, "slow", PYTHONPATH=slow_wires, SLOW_WIRES_SHARE="0.01")
    assert len(quick) > 20
    assert quick == slow
