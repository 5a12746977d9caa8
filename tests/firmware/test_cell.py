"""The loop closed: the simulated world bends the pin, the firmware times the edge, the shipped driver reads it."""

import json
import os
import subprocess
import sys
from dataclasses import replace

import pytest

from cellctl.engine import State
from cellctl.journal import read_journal
from tests.firmware.conftest import HERE
from tests.helpers.runs import (
    FASTEST,
    PATIENCE_S,
    ROOT,
    SELFCAL,
    UNHURRIED,
    only_run,
    run_here,
    touches_procedure,
    unhurried,
)

CELL = HERE / "firmware_cell.yaml"
KIT = HERE / "firmware_kit"
STAND_OFF_MM = 0.05

pytestmark = [pytest.mark.campaign, pytest.mark.long]


def cell_file(folder, simulate=""):
    """The cell, with lines added to its `simulate:` section."""
    text = CELL.read_text(encoding="utf-8").replace("../../procedures", str(ROOT / "procedures"))
    (folder / "cell.yaml").write_text(text + simulate, encoding="utf-8")
    return folder / "cell.yaml"


@pytest.fixture
def run(images, tmp_path):
    """Runs a procedure on the cell whose probe is the firmware; returns the process, ended."""

    def go(procedure, *words, simulate="", runs="runs"):
        command = [sys.executable, "-m", "cellctl", "run", procedure, "--cell", cell_file(tmp_path, simulate)]
        return subprocess.run(
            [*command, "--runs", tmp_path / runs, *words],
            env={**os.environ, "PYTHONPATH": str(KIT)},
            cwd=ROOT,
            capture_output=True,
            text=True,
            timeout=PATIENCE_S,
            check=False,
        )

    return go


def test_a_self_calibration_with_the_firmware_stands_off_within_a_twentieth_of_a_millimetre(run, tmp_path):
    # at the highest speeds: the processor's every cycle costs, and where a contact is measured does not depend on them
    settings = ("touches_fit=36", "touches_test=8", "standoff_targets=6", *FASTEST)
    words = [f"--set={setting}" for setting in settings]
    done = run(SELFCAL, "--json", tmp_path / "result.json", *words)
    assert done.returncode == 0, done.stderr
    assert "fw-1.0" in done.stdout
    result = json.loads((tmp_path / "result.json").read_text())
    assert result["verdict"] == "better"
    print(result["sentence"])
    assert result["after"]["mean"] <= STAND_OFF_MM


def test_in_lockstep_the_same_seed_gives_the_same_journal(run, tmp_path):
    journals = []
    for name in ("one", "other"):
        done = run(touches_procedure(tmp_path, speed_mm_s=10), runs=name)
        assert done.returncode == 0, done.stderr
        _, *later = read_journal(only_run(tmp_path / name))
        *events, (ended_ns, ended) = ((entry.time_ns, entry.event) for entry in later)
        journals.append([*events, (ended_ns, replace(ended, calendar=""))])
    assert len(journals[0]) > 20
    assert journals[0] == journals[1]


@pytest.mark.realtime
def test_touches_in_real_time(images, tmp_path, monkeypatch):
    unhurried(monkeypatch)
    monkeypatch.syspath_prepend(KIT)
    monkeypatch.setenv("PYTHONPATH", str(KIT))
    ended = run_here(touches_procedure(tmp_path), cell_file(tmp_path, UNHURRIED), tmp_path, clock="realtime")
    assert ended.outcome.state is State.FINISHED
    assert len(ended.touches) == 6
    assert ended.robot_is_held()


def test_a_wire_break_in_a_search_ends_the_run(run, tmp_path):
    fault = "  faults: [{fault: probe.wire_break, search: 2, after_ms: 400}]\n"
    done = run(touches_procedure(tmp_path), simulate=fault)
    assert done.returncode != 0
    assert "the loop is broken (fault WIRE)" in done.stderr


def test_a_program_that_hangs_in_a_search_ends_the_run_with_its_reset(run, tmp_path):
    fault = "  faults: [{fault: probe.reset, search: 2, after_ms: 400}]\n"
    done = run(touches_procedure(tmp_path), simulate=fault)
    assert done.returncode != 0
    assert "was reset while armed (cause WATCHDOG)" in done.stderr
