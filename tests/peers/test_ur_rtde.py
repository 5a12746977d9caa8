"""ur_rtde, a client of real UR controllers that we did not write, drives the simulated one, which is another process.

Its control interface sends a program of 1300 lines, which the simulator reads and executes. It hangs if the server is
in its own process.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from tests.helpers.runs import ROOT

CELL = ROOT / "tests/sims/ur/ur10e_cell.yaml"
SESSION = Path(__file__).with_name("ur_rtde_session.py")
PATIENCE_S = 300.0

pytestmark = pytest.mark.realtime

pytest.importorskip("rtde_control")  # dependency group 'peers'


@pytest.fixture
def controller(tmp_path):
    """Start a simulated controller in real time; its host."""
    processes = []

    def begin(**ur):
        cell = yaml.safe_load(CELL.read_text())
        cell["simulate"].update(ur=ur)
        (tmp_path / "cell.yaml").write_text(yaml.safe_dump(cell))
        command = [sys.executable, "-m", "sims", "run", str(tmp_path / "cell.yaml"), "--clock", "realtime"]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=ROOT)
        processes.append(process)
        return json.loads(process.stdout.readline())["robot"].removeprefix("ur+rtde://")

    yield begin
    for process in processes:
        process.terminate()
        process.communicate()


def session(part, host):
    """What the foreign client found, in a process of its own: it never gives up a connection that does not answer."""
    done = subprocess.run(
        [sys.executable, str(SESSION), part, host], capture_output=True, text=True, timeout=PATIENCE_S, check=False
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


@pytest.mark.long
def test_receive_control_dashboard_and_io_of_ur_rtde(controller):
    """A CB3's 125 Hz: the control program, moves, speeds, kinematics, inputs and outputs."""
    found = session("control", controller(series="cb3"))
    assert found["moved"] == pytest.approx(found["goal"], abs=1e-4)
    assert found["line"] == pytest.approx(found["line_goal"], abs=1e-4)
    assert found["inverse"] == pytest.approx(found["moved"], abs=1e-3)
    assert found["forward"] == pytest.approx(found["pose"], abs=1e-3)
    assert found["speed"] == pytest.approx([0, 0, -0.02, 0, 0, 0], abs=2e-3)
    assert found["stopped"] == pytest.approx([0] * 6, abs=1e-3)
    assert found["output"] is True
    assert found["slider"] == 0.5
    assert found["payload"] == 1.5
    assert found["state"] == "STOPPED <unnamed>"


def test_receive_and_dashboard_of_an_e_series(controller):
    found = session("receive", controller(series="e", power="off"))
    assert found["version"] == "5.12.4.0"
    assert found["serial"].isdigit()
    assert found["remote"] is True
    assert found["modes"] == ["Robotmode: POWER_OFF", "Robotmode: RUNNING", "Robotmode: POWER_OFF"]
    assert found["q"] == pytest.approx([0, -1.5708, 1.5708, -1.5708, -1.5708, 0], abs=1e-3)
    assert found["later"] > found["earlier"]
    assert len(found["currents"]) == 6
