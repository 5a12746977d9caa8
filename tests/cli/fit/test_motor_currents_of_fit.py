"""`--model geometry+motor` on the command line: the fit, a prediction with and without currents, and a table."""

import pytest

from tests.helpers.runs import cellctl
from tests.helpers.simulated_data import KR5_FILE, motor_rows, motor_world

JOINTS = "A1,A2,A3,A4,A5,A6"
POSTURE = "10,-80,85,20,40,30"


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    folder = tmp_path_factory.mktemp("motor")
    data = motor_rows(motor_world(1, 1.0), 140, 6).write(folder / "rows.csv", 60)
    fit = cellctl(
        "fit", KR5_FILE, data, "--measure", "position", "--model", "geometry+motor", "--out", folder / "m.json"
    )
    assert fit.returncode == 0, fit.stderr
    assert "Better than nominal" in fit.stdout + fit.stderr
    return folder / "m.json"


def predicted(model, tmp_path, text):
    (tmp_path / "joints.csv").write_text(text)
    done = cellctl("predict", model, tmp_path / "joints.csv")
    assert done.returncode == 0, done.stderr
    return done


@pytest.mark.long
def test_a_prediction_without_currents_says_what_is_missing(model, tmp_path):
    without = predicted(model, tmp_path, f"{JOINTS}\n{POSTURE}\n")
    assert "1 of 1 rows without I1…I6: predicted without flexibility by motor current" in without.stderr
    given = predicted(model, tmp_path, f"{JOINTS},I1,I2,I3,I4,I5,I6\n{POSTURE},0.3,2,-1,0.2,0.4,0.1\n")
    assert "without" not in given.stderr
    assert given.stdout != without.stdout


def test_a_table_from_a_model_with_currents_is_refused_with_the_cure(model, tmp_path):
    (tmp_path / "targets.csv").write_text("X,Y,Z,A,B,C\n1000,0,800,0,90,0\n")
    done = cellctl("compensate", model, tmp_path / "targets.csv", "--serial", "SIM-1", "-o", tmp_path / "t.json")
    assert done.returncode != 0
    assert "includes the flexibility by motor current, and a target has no current" in done.stderr
    assert "--model geometry+compliance" in done.stderr
