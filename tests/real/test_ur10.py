"""Real measurements: 3000 held-out tracker points of a UR10, by way of the documented commands."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cellctl.cli import exit_codes
from cellctl.cli.verbs import app
from cellctl.formats import ModelFile
from tests.helpers.real_data import public_data

ROOT = Path(__file__).parents[2]
DATA = ROOT.parent / "shared" / "data" / "ur10_tracker" / "measurements_grid.csv"

pytestmark = pytest.mark.skipif(not DATA.exists(), reason=f"the UR10 measurements are not at {DATA}")


def cellctl(*arguments):
    return exit_codes.exit_code_of(lambda: app([str(argument) for argument in arguments], standalone_mode=False))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with the `ur10.csv` of the documentation."""
    made = tmp_path_factory.mktemp("ur10")
    public_data(DATA, "800", "--held-out", "3000", "--temperature", "-o", made / "ur10.csv")
    return made


@pytest.fixture(scope="module")
def result(folder):
    robot = ROOT / "procedures" / "robots" / "ur10.yaml"
    options = ["--measure", "position", "--model", "geometry", "--out", folder / "m.json", "--json", folder / "r.json"]
    assert cellctl("fit", robot, folder / "ur10.csv", *options) == 0
    return json.loads((folder / "r.json").read_text())


def test_identified_geometry_halves_the_error_at_points_never_seen(result):
    assert (result["n_fit"], result["n_test"]) == (800, 3000)
    assert result["test"]["mean"] <= 0.40
    assert 0.70 <= result["nominal"]["mean"] <= 0.80
    assert result["verdict"] == "better"


@pytest.mark.long
@pytest.mark.parametrize("sister", ["ur5", "ur16e"])
def test_the_file_of_a_sister_is_refused_with_the_lengths_and_the_robot_that_was_measured(folder, capsys, sister):
    assert cellctl("fit", sister, folder / "ur10.csv", "--measure", "position", "--model", "geometry") == 2
    told = capsys.readouterr().err
    assert f"{sister}.yaml:" in told
    assert "this is not the robot that was measured: its rows need other lengths, a" in told
    assert "give the file of the robot that was measured: ur10 of the library." in told


@pytest.mark.long
def test_auto_is_no_worse_and_says_what_it_kept(folder, result):
    robot = ROOT / "procedures" / "robots" / "ur10.yaml"
    assert cellctl("fit", robot, folder / "ur10.csv", "--measure", "position", "--json", folder / "a.json") == 0
    auto = json.loads((folder / "a.json").read_text())
    assert auto["test"]["mean"] <= result["test"]["mean"]
    assert [step["model"] for step in auto["ladder"] if step["kept"]][1:3] == ["geometry", "geometry+compliance"]


def test_the_predicted_error_is_the_one_found(result):
    assert result["predicted_test_rms"] == pytest.approx(result["test"]["rms"], rel=0.05)
    assert 0.90 <= result["coverage_95"] <= 0.98


def test_a_compensated_target_has_the_sigma_of_the_prediction_at_its_joints(folder, result):
    """The target is what the model predicts at held-out joints: `compensate` gives these back, with the same σ."""
    rows = [row for row in csv.DictReader((folder / "ur10.csv").open()) if row["set"] == "test"]
    joints = [f"A{axis}" for axis in range(1, 7)]
    model = ModelFile.load(folder / "m.json")
    readings = np.rad2deg([[float(row[f"q{axis}"]) for axis in range(1, 7)] for row in rows])
    chosen = readings[model.inside(readings)][:40].round(6)
    write(folder / "held.csv", joints, chosen)
    assert cellctl("predict", folder / "m.json", folder / "held.csv", "-o", folder / "tcp.csv") == 0
    predicted = list(csv.DictReader((folder / "tcp.csv").open()))
    poses = np.array([[float(row[name]) for name in "XYZABC"] for row in predicted])
    write(folder / "targets.csv", ["X", "Y", "Z", "A", "B", "C", *joints], np.hstack([poses, chosen]))
    options = ["-o", folder / "made.csv", "--json", folder / "made.json"]
    assert cellctl("compensate", folder / "m.json", folder / "targets.csv", *options) == 0
    made = list(csv.DictReader((folder / "made.csv").open()))
    np.testing.assert_allclose([[float(row[name]) for name in joints] for row in made], chosen, atol=2e-6)
    sigma = np.array([float(row["sigma"]) for row in predicted])
    np.testing.assert_allclose([float(row["sigma_mm"]) for row in made], sigma, atol=1.1e-9)
    among = np.sqrt(np.mean([float(row["sigma_among"]) ** 2 for row in predicted]))
    assert json.loads((folder / "made.json").read_text())["sigma_among_rows_mm"] == pytest.approx(among, abs=1e-8)


def write(path, names, values):
    path.write_text("\n".join([",".join(names), *(",".join(map(repr, row)) for row in values.tolist())]) + "\n")


def test_a_reflector_on_the_last_axis_leaves_its_zero_unseen(result):
    assert any(words.startswith("θ6 with tool") for words in result["unobservable"])


def test_the_model_predicts_the_held_out_points(folder, result):
    import math

    out = folder / "tcp.csv"
    assert cellctl("predict", folder / "m.json", folder / "ur10.csv", "-o", out) == 0
    measured = list(csv.DictReader((folder / "ur10.csv").open()))
    said = list(csv.DictReader(out.open()))
    errors = [
        math.dist([float(a[k]) for k in "XYZ"], [float(b[k]) for k in "XYZ"])
        for a, b in zip(said, measured, strict=True)
        if b["set"] == "test"
    ]
    assert sum(errors) / len(errors) == pytest.approx(result["test"]["mean"], abs=1e-6)


@pytest.fixture(scope="module")
def moved(folder):
    """40 rows each, the tracker moved: `near.csv` at joints where `prior.json` was measured, `far.csv` elsewhere."""
    rows = list(csv.DictReader((folder / "ur10.csv").open()))
    order = np.random.default_rng(0).permutation(len(rows))
    angles = np.degrees([float(row["q1"]) for row in rows])
    low, high = ([rows[i] for i in order if sign * (angles[i] - np.median(angles)) > 5.0] for sign in (-1, 1))
    _write(folder / "then.csv", low[:150], Rotation.identity(), np.zeros(3))
    for name, chosen in (("near", low[150:190]), ("far", high[:40])):
        turn = Rotation.from_euler("zyx", [40.0, 25.0, -30.0], degrees=True)
        _write(folder / f"{name}.csv", chosen, turn, np.array([2500.0, -1800.0, 700.0]))
    robot = ROOT / "procedures" / "robots" / "ur10.yaml"
    assert cellctl("fit", robot, folder / "then.csv", "--model", "geometry", "--out", folder / "prior.json") == 0
    return folder


def _write(path, rows, turn, shift):
    names = ["q1", "q2", "q3", "q4", "q5", "q6", "X", "Y", "Z", "temperature"]
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, names, extrasaction="ignore")
        writer.writeheader()
        for row in rows:
            place = turn.apply([float(row[axis]) for axis in "XYZ"]) + shift
            writer.writerow({**row, **dict(zip("XYZ", place.tolist(), strict=True))})


def _after(folder, rows, *options):
    robot, out = (
        ROOT / "procedures" / "robots" / "ur10.yaml",
        ["--out", folder / "n.json", "--json", folder / "n.r.json"],
    )
    assert cellctl("fit", robot, folder / rows, "--prior", folder / "prior.json", *options, *out) in (0, 1)
    return json.loads((folder / "n.r.json").read_text()), json.loads((folder / "n.json").read_text())


@pytest.mark.long
@pytest.mark.parametrize("options", [(), ("--free", "base")])
def test_a_moved_tracker_is_recognised_and_the_prior_model_holds(moved, options):
    result, _ = _after(moved, "near.csv", *options)
    assert result["verdict"] == "better"
    assert "moved since the prior model" in result["sentence"]
    assert result["nominal"]["mean"] > 1.3 * result["prior"]["mean"]
    assert result["predicted_test_rms"] == pytest.approx(result["test"]["rms"], rel=0.2)


@pytest.mark.long
def test_joints_where_only_the_tracker_was_found_anew_are_not_measured_region(moved):
    result, model = _after(moved, "far.csv", "--free", "base")
    assert model["joint_region"] == json.loads((moved / "prior.json").read_text())["joint_region"]
    assert 0.7 < result["predicted_test_rms"] / result["test"]["rms"] < 2.2  # single sets: docs/results.md
    assert result["nominal"]["max"] < 3.0
    assert not ModelFile.load(moved / "n.json").inside(np.array([[-48.0, -52.0, 44.0, 10.0, 40.0, -20.0]])).any()
