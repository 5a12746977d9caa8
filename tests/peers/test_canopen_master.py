"""The simulated drives and a master that we did not write: canopen, with cantools as a second decoder.

The session runs in a process that imports neither cellctl nor drivers (tests/peers/canopen_session.py).
"""

import json
import select
import subprocess
import sys
from pathlib import Path
from urllib.parse import urlsplit

import pytest

from tests.helpers.simulated_robots import DRIVES, cell_file

ROOT = Path(__file__).parents[2]
PATIENCE_S = 120


@pytest.fixture
def session(tmp_path):
    """What the master read in a session with the simulators of a cell in real time."""
    pytest.importorskip("cantools")
    cell = cell_file(tmp_path, {"seed": 3, "clock": "realtime", "drives": {"brakes_after_s": 1000}}, {"drives": DRIVES})
    command = [sys.executable, "-m", "sims", "run", str(cell)]
    simulators = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True)
    try:
        assert select.select([simulators.stdout], [], [], PATIENCE_S)[0], "the simulators do not get ready"
        place = urlsplit(json.loads(simulators.stdout.readline())["drives"])
        master = [sys.executable, str(ROOT / "tests/peers/canopen_session.py"), place.hostname, str(place.port)]
        done = subprocess.run(master, capture_output=True, text=True, timeout=PATIENCE_S, check=False, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        yield json.loads(done.stdout)
    finally:
        simulators.terminate()
        simulators.communicate(timeout=PATIENCE_S)


def test_a_foreign_master_and_a_foreign_decoder_agree_on_a_session(session):
    assert session["ours"] == []
    assert session["states"] == ["OPERATIONAL"] * 6
    assert set(session["canopen"]) == set(session["cantools"]) == {str(node) for node in range(1, 7)}
    for node, (position, current, torque) in session["canopen"].items():
        decoded = session["cantools"][node]
        assert decoded == pytest.approx([position, current * 0.1, torque * 0.1])
        axis = int(node) - 1
        assert position == session["position"][axis]
        assert abs(current - session["current"][axis]) < 40  # per mille; another sample's noise
    assert session["position"] == [0, -900_000, 900_000, 0, 450_000, 0]
    assert all(2000 < rated < 10_000 for rated in session["rated_ma"])
    assert session["rated_mnm"] == [round(0.4 * rated) for rated in session["rated_ma"]]
    assert all(word & 0x6F == 0x27 for word in session["statusword"])
