"""A device that nobody knew of works by its entry points alone: driver, simulator, fault, campaign, row, section.

The package is `thermometer_kit`, on the path of the processes and installed nowhere. No line of cellctl, drivers, sims
or procedures names it.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

KIT = Path(__file__).parent / "thermometer_kit"
ROOT = Path(__file__).parents[2]
PATIENCE_S = 300

CELL = """\
name: thermometer cell
model: ROBOT
devices:
  thermometer: thermometer+tcp://10.0.0.9:7000
simulate:
  seed: 1
  clock: lockstep
  thermometer: {start: 22.5}
"""


@pytest.fixture
def cellctl(tmp_path):
    """Runs the command line with the invented package on the path, in a folder with its cell."""
    (tmp_path / "cell.yaml").write_text(CELL.replace("ROBOT", str(ROOT / "procedures/robots/kr5_r1400.yaml")))

    def run(*words):
        path = os.pathsep.join([str(KIT), str(ROOT)])
        program = ["-m", "cellctl"] if words[0] != "-c" else []
        return subprocess.run(
            [sys.executable, *program, *words],
            cwd=tmp_path,
            env={**os.environ, "PYTHONPATH": path},
            capture_output=True,
            text=True,
            timeout=PATIENCE_S,
            check=False,
        )

    return run


def test_nothing_of_ours_names_it():
    ours = [path for top in ("cellctl", "drivers", "sims", "procedures") for path in (ROOT / top).rglob("*.py")]
    assert len(ours) > 100
    assert not [path for path in ours if "thermometer" in path.read_text(encoding="utf-8")]


@pytest.mark.long
def test_its_campaign_is_checked_run_shown_and_reported(cellctl, tmp_path):
    checked = cellctl("check", "temperatures", "--cell", "cell.yaml")
    assert checked.returncode == 0, checked.stderr
    done = cellctl("run", "temperatures", "--cell", "cell.yaml", "--json", "result.json")
    assert done.returncode == 0, done.stderr
    result = json.loads((tmp_path / "result.json").read_text())
    assert (result["state"], result["points"], result["verdict"]) == ("finished", 5, None)
    page = (tmp_path / "runs" / result["run"] / "report.html").read_text()
    assert "Temperature of the cell" in page
    assert "5 readings, from 22." in page


HISTORY = """
from pathlib import Path
from starlette.testclient import TestClient
from cellctl.console.server import Settings, api_app, new_console
from cellctl.console.frame import NAVIGATION
Path("runs/one").mkdir(parents=True)
Path("runs/one/journal.sqlite").touch()
print(dict(NAVIGATION)["Temperatures"])
print(TestClient(api_app(new_console(Settings(Path("runs"))))).get("/api/temperature").json())
"""


@pytest.mark.long
def test_its_history_is_in_the_navigation_and_has_a_route(cellctl):
    done = cellctl("-c", HISTORY)
    assert done.stdout.splitlines() == ["/temperature", "{'runs': 1}"], done.stderr


@pytest.mark.long
def test_its_fault_at_its_event_ends_the_run_with_what_to_do(cellctl, tmp_path):
    cell = (tmp_path / "cell.yaml").read_text()
    fault = "  faults: [{fault: thermometer.silent, event: thermometer.read, count: 4}]\n"
    (tmp_path / "cell.yaml").write_text(cell + fault)
    done = cellctl("run", "temperatures", "--cell", "cell.yaml", "--json", "result.json")
    assert done.returncode == 3
    assert "thermometer: no answer to READ for 1 s" in done.stderr
    assert "look at its cable" in done.stderr
    assert json.loads((tmp_path / "result.json").read_text())["state"] == "failed"


def test_a_wrong_setting_and_an_unknown_event_of_it_are_found_by_check(cellctl, tmp_path):
    cell = (tmp_path / "cell.yaml").read_text().replace("{start: 22.5}", "{start: -80}")
    fault = "  faults: [{fault: thermometer.silent, event: thermometer.melt}]\n"
    (tmp_path / "cell.yaml").write_text(cell + fault)
    checked = cellctl("check", "temperatures", "--cell", "cell.yaml")
    assert checked.returncode == 2
    assert "at least -50 is expected" in checked.stderr
    assert "thermometer.melt" in checked.stderr
    assert "thermometer.read" in checked.stderr
