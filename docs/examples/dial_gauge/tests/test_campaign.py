"""The campaign on the simulated cell, as the command line runs it."""

import json
import subprocess
import sys

import pytest


@pytest.fixture
def cellctl(tmp_path):
    def run(*words):
        command = [sys.executable, "-m", "cellctl", *words]
        return subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=300, check=False)

    return run


def test_it_states_the_drift_that_the_cell_file_simulates(cellctl, tmp_path):
    done = cellctl("run", "dial_gauge_drift", "--json", "result.json")
    assert done.returncode == 0, done.stderr
    result = json.loads((tmp_path / "result.json").read_text())
    assert (result["state"], result["points"]) == ("finished", 5)
    assert result["dial_gauge_mm"] == pytest.approx(0.04, abs=0.006)
    assert "Readings of the dial gauge" in (tmp_path / "runs" / result["run"] / "report.html").read_text()
