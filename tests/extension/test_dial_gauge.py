"""A device of another package works by its entry points alone: driver, simulator, fault, campaign, row, section.

The package is the example `dial_gauge`, on the path of the processes and installed nowhere. No line of cellctl,
drivers, sims or procedures names it. Its own tests run in `test_new_packages.py`.
"""

import json
import os
import shutil
import subprocess
import sys

import pytest

from tests.helpers.examples import EXAMPLES, paths_of
from tests.helpers.runs import ROOT

PATIENCE_S = 300
CELL = (EXAMPLES / "dial_gauge" / "dial_gauge" / "cells" / "dial_gauge_cell.yaml").read_text()


@pytest.fixture
def cellctl(tmp_path):
    """Runs the command line with the example on the path, in a folder with its cell."""
    return command_line(tmp_path, EXAMPLES / "dial_gauge")


def command_line(tmp_path, package):
    (tmp_path / "cell.yaml").write_text(CELL)
    places = paths_of(package, tmp_path / "site")

    def run(*words):
        program = ["-m", "cellctl"] if words[0] != "-c" else []
        return subprocess.run(
            [sys.executable, *program, *words],
            cwd=tmp_path,
            env={**os.environ, "PYTHONPATH": os.pathsep.join([*places, str(ROOT)])},
            capture_output=True,
            text=True,
            timeout=PATIENCE_S,
            check=False,
        )

    return run


def test_nothing_of_ours_names_it():
    ours = [path for top in ("cellctl", "drivers", "sims", "procedures") for path in (ROOT / top).rglob("*.py")]
    assert len(ours) > 100
    named = {path.name for path in ours if "dial_gauge" in path.read_text(encoding="utf-8")}
    assert named == {"new.py", "new_package.py"}, "they make packages from it"


HISTORY = """
from pathlib import Path
from starlette.testclient import TestClient
from cellctl.console.server import Settings, api_app, new_console
from cellctl.console.frame import NAVIGATION
from cellctl.journal import Journal, Recorded, RunStarted, SourceFile, StateChanged
runs = Path("runs")
source = SourceFile("dial_gauge_drift.yaml", "", "")
with Journal.create(runs / "one", lambda: 0) as journal:
    journal.append(RunStarted(source, source, {}, 1, "lockstep", "me", "2026-01-01T08:00:00Z", "", {}, section=()))
    for mm in (1.0, 1.25):
        journal.append(Recorded("dial_gauge_length", {"number": 1, "time_s": 0.0, "mm": mm}))
    journal.append(StateChanged("running", "finished"))
print(dict(NAVIGATION)["Dial gauge"])
with TestClient(api_app(new_console(Settings(runs)))) as client:
    print(client.get("/api/dial_gauge_mm").json()["histories"])
"""


@pytest.mark.long
def test_its_history_is_in_the_navigation_and_has_a_route(cellctl):
    done = cellctl("-c", HISTORY)
    assert done.stdout.splitlines() == ["/dial_gauge_mm", "[{'runs': {'one': 0.25}}]"], done.stderr


@pytest.mark.long
def test_its_fault_at_its_event_ends_the_run_with_what_to_do(cellctl, tmp_path):
    cell = (tmp_path / "cell.yaml").read_text()
    fault = "  faults: [{fault: dial_gauge.silent, event: dial_gauge.read, count: 4}]\n"
    (tmp_path / "cell.yaml").write_text(cell + fault)
    done = cellctl("run", "dial_gauge_drift", "--cell", "cell.yaml", "--json", "result.json")
    assert done.returncode == 3
    assert "gauge: no answer to ? for 1 s" in done.stderr
    assert "look at its cable and its battery" in done.stderr
    assert json.loads((tmp_path / "result.json").read_text())["state"] == "failed"


@pytest.mark.long
def test_a_wrong_setting_and_an_unknown_event_of_it_are_found_by_check(cellctl, tmp_path):
    cell = (tmp_path / "cell.yaml").read_text().replace("drift_mm_min: 0.01", "drift_mm_min: -80")
    fault = "  faults: [{fault: dial_gauge.silent, event: dial_gauge.melt}]\n"
    (tmp_path / "cell.yaml").write_text(cell + fault)
    checked = cellctl("check", "dial_gauge_drift", "--cell", "cell.yaml")
    assert checked.returncode == 2
    assert "at least -1 is expected" in checked.stderr
    assert "dial_gauge.melt" in checked.stderr
    assert "dial_gauge.read" in checked.stderr


def test_a_simulator_that_crashes_is_named_with_its_line(tmp_path):
    """Else its author would see devices that are silent, and look for the error in the driver."""
    shutil.copytree(EXAMPLES / "dial_gauge", tmp_path / "crashing")
    module = tmp_path / "crashing" / "dial_gauge" / "simulator.py"
    before, mark, after = module.read_text().partition("            self._setup.faults.announce(READ)\n")
    module.write_text(f"{before}            raise TypeError('a planted error')\n{after}")
    done = command_line(tmp_path, tmp_path / "crashing")("run", "dial_gauge_drift", "--cell", "cell.yaml")
    line = before.count("\n") + 1
    assert mark
    assert done.returncode == 4
    assert f"the simulated cell ended with code 1: TypeError: a planted error (simulator.py:{line})" in done.stderr
    (log,) = (tmp_path / "runs").glob("*/simulated_cell.log")
    assert "Traceback" in log.read_text()
