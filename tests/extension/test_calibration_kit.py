"""An effect, a compensation method and a row kind that nobody knew of work by their entry points alone.

The package is the example `calibration_kit`, on the path of the processes and installed nowhere.
"""

import json
import os
import shutil
import subprocess
import sys

import numpy as np
import pytest

from tests.helpers import arms
from tests.helpers.examples import EXAMPLES, paths_of
from tests.helpers.runs import ROOT
from tests.helpers.simulated_data import positions_in_the_heat

BROKEN = "[cellctl.effects]\nbroken = calibration_kit.method:damped_pass\n"
PER_K = np.array([0.004, -0.002, 0.012])
"""By which the tool moves in the flange's frame, mm/K."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """With the robot, its data, and the model that was fitted with the invented effect."""
    folder = tmp_path_factory.mktemp("kit")
    paths_of(EXAMPLES / "calibration_kit", folder / "site", BROKEN)
    (folder / "robot.yaml").write_text(arms.ELBOW_ROBOT)
    (folder / "data.csv").write_text(positions_in_the_heat(PER_K))
    done = cellctl(folder, "fit", "robot.yaml", "data.csv", "--model", "geometry+tool_heat", "--out", "model.json")
    assert done.returncode == 0, done.stderr
    assert "effect 'broken' (calibration_kit.method:damped_pass) is no type" in done.stderr
    return folder


def cellctl(folder, *words, kit=True):
    command = [sys.executable, "-m", "cellctl", *words]
    places = [str(folder / "site"), str(EXAMPLES / "calibration_kit")] if kit else []
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([*places, str(ROOT)])}
    options = {"capture_output": True, "text": True, "timeout": 300, "check": False}
    return subprocess.run(command, cwd=folder, env=environment, **options)


@pytest.mark.long
def test_the_model_file_has_the_effect_with_its_amounts(folder):
    model = json.loads((folder / "model.json").read_text())
    assert "tool_heat" in json.dumps(model)
    done = cellctl(folder, "predict", "model.json", "data.csv")
    assert done.returncode == 0, done.stderr
    assert len(done.stdout.splitlines()) == 121


@pytest.mark.long
def test_without_the_package_the_model_file_says_which_effect_is_missing(folder):
    done = cellctl(folder, "predict", "model.json", "data.csv", kit=False)
    assert done.returncode == 2
    assert "'tool_heat' is no kind of effect" in done.stderr


@pytest.mark.long
def test_the_method_compensates_targets_as_well_as_the_shipped_ones(folder):
    for name in ("six.yaml", "poses.csv", "joints.csv"):
        shutil.copy(ROOT / "tests" / "golden" / "inputs" / name, folder)
    fitted = cellctl(folder, "fit", "six.yaml", "poses.csv", "--model", "geometry", "--out", "six.json")
    assert fitted.returncode == 0, fitted.stderr
    assert cellctl(folder, "predict", "six.json", "joints.csv", "-o", "targets.csv").returncode == 0
    words = ("--method", "damped", "--out", "table.csv", "--json", "figures.json")
    done = cellctl(folder, "compensate", "six.json", "targets.csv", *words)
    assert done.returncode == 0, done.stderr
    found = json.loads((folder / "figures.json").read_text())
    assert found["method"] == "damped"


@pytest.fixture(scope="module")
def with_heights(folder):
    """The robot's data with 60 positions and 60 heights, two of these in one posture; one height is far off."""
    rng = np.random.default_rng(6)
    readings = arms.drawn(rng, 120)
    readings[100] = readings[101]
    places = arms.ElbowArm().tcp(readings) + rng.normal(0.0, 0.01, (120, 3))
    cells = {name: list(map(str, values)) for name, values in arms.joints_and_places(readings, places).items()}
    cells["height"] = [""] * 60 + cells["Z"][60:]
    cells["height"][70] = str(places[70, 2] + 2.0)
    for axis in "XYZ":
        cells[axis][60:] = [""] * 60
    (folder / "heights.csv").write_text(arms.csv_text(cells))
    return folder


@pytest.mark.long
def test_rows_of_the_kind_are_fitted_and_judged_with_those_of_cellctl(with_heights):
    words = ("--model", "geometry", "--json", "fit.json", "--report", "fit.html")
    done = cellctl(with_heights, "fit", "robot.yaml", "heights.csv", *words)
    assert done.returncode == 0, done.stderr
    found = json.loads((with_heights / "fit.json").read_text())
    assert found["measure"] == "position+height"
    assert (found["n_test"], found["rejected"]) == (120, [])
    assert [outlier["line"] for outlier in found["outliers"]] == [72]
    assert found["fit"]["rms"] < 0.03
    assert "60 heights" in (with_heights / "fit.html").read_text()


@pytest.mark.long
def test_without_the_package_the_rows_of_its_kind_are_rejected(with_heights):
    done = cellctl(with_heights, "fit", "robot.yaml", "heights.csv", "--model", "geometry", kit=False)
    assert "line 62: not used: X is missing" in done.stderr


@pytest.mark.long
def test_the_option_measure_knows_the_kind(with_heights):
    done = cellctl(with_heights, "fit", "robot.yaml", "heights.csv", "--measure", "weight")
    assert done.returncode == 2
    assert "position, height" in done.stderr
