"""Partial work: after a crash, with a new tool, where the robot has been set up anew, with ten rows each."""

import csv
import json
import math
from dataclasses import replace

import numpy as np
import pytest

from tests.helpers.arms import ELBOW_ROBOT, ElbowArm, cellctl, csv_text, drawn, identified_elbow, joints_and_places

NOISE_MM = 0.02 / math.sqrt(3)
ARM = ElbowArm()


def measured(arm, count, seed):
    rng = np.random.default_rng(seed)
    readings = drawn(rng, count)
    return csv_text(joints_and_places(readings, arm.tcp(readings) + rng.normal(0, NOISE_MM, (count, 3))))


@pytest.fixture(scope="module")
def older(tmp_path_factory):
    """A folder with the robot file and `model.json`, identified from 60 positions before anything happened."""
    return identified_elbow(tmp_path_factory.mktemp("older"), measured(ARM, 60, 1))


@pytest.fixture
def folder(older, monkeypatch):
    monkeypatch.chdir(older)
    return older


def afterwards(folder, arm, *options, rows=10, code=0):
    """The result of a fit of a few rows of `arm` with the older model as prior; the new model is `new.json`."""
    (folder / "few.csv").write_text(measured(arm, rows, 2))
    words = ["fit", "robot.yaml", "few.csv", "--prior", "model.json", "--out", "new.json", "--json", "r.json"]
    assert cellctl(*words, *options) == code
    return json.loads((folder / "r.json").read_text())


def errors_of(folder, model, arm, readings, said=None):
    """How far predictions of `model` at `said` (default the same readings) are from where the arm is at `readings`."""
    joints = readings if said is None else said
    (folder / "asked.csv").write_text(csv_text({f"A{j + 1}": joints[:, j] for j in range(3)}))
    assert cellctl("predict", model, "asked.csv", "-o", "tcp.csv") == 0
    rows = list(csv.DictReader((folder / "tcp.csv").open()))
    places = np.array([[float(row[name]) for name in "XYZ"] for row in rows])
    return np.linalg.norm(places - arm.tcp(readings), axis=1)


def test_lost_mastering_comes_back_as_what_has_to_be_added_to_the_controllers_readings(folder, capsys):
    lost = (0.4, -1.2, 0.7)
    result = afterwards(folder, replace(ARM, lost_deg=lost), "--free", "zeros")
    found = result["mastering"]
    assert [row["joint"] for row in found] == ["A1", "A2", "A3"]
    for row, true in zip(found, lost, strict=True):
        assert abs(row["offset_deg"] - true) < max(4 * row["sigma_deg"], 0.002)
        assert row["sigma_deg"] < 0.02
    assert result["groups"] == ["zeros"]
    assert "A2  -1.2" in capsys.readouterr().out


def test_with_the_offsets_entered_the_prior_model_holds_again(folder):
    crashed = replace(ARM, lost_deg=(0.4, -1.2, 0.7))
    offsets = [row["offset_deg"] for row in afterwards(folder, crashed, "--free", "zeros")["mastering"]]
    readings = drawn(np.random.default_rng(3), 40)
    assert errors_of(folder, "model.json", crashed, readings).min() > 2.0
    assert errors_of(folder, "model.json", crashed, readings, readings + offsets).max() < 0.1


def test_a_new_tool_in_ten_rows(folder):
    retooled = replace(ARM, tool=(12.0, -7.0, 30.0))
    result = afterwards(folder, retooled, "--free", "tool")
    assert result["verdict"] == "better"
    assert result["mastering"] == []
    assert errors_of(folder, "new.json", retooled, drawn(np.random.default_rng(3), 40)).max() < 0.1


def test_a_robot_set_up_anew_in_ten_rows(folder):
    moved = replace(ARM, at=(300.0, -250.0, 90.0), turn_deg=35.0)
    result = afterwards(folder, moved, "--free", "base")
    assert result["verdict"] == "better"
    assert errors_of(folder, "new.json", moved, drawn(np.random.default_rng(3), 40)).max() < 0.1


def test_an_update_is_surer_than_the_prior_model_and_has_seen_what_that_saw(folder):
    afterwards(folder, ARM, rows=30, code=1)
    older, newer = (json.loads((folder / name).read_text()) for name in ("model.json", "new.json"))
    sigma = [{row["name"]: row["sigma"] for row in model["parameters"]} for model in (older, newer)]
    assert sigma[1]["a2"] < sigma[0]["a2"]
    assert all(new <= old for old, new in zip(older["joint_region"]["min"], newer["joint_region"]["min"], strict=True))
    assert errors_of(folder, "new.json", ARM, drawn(np.random.default_rng(3), 40)).max() < 0.1
    assert newer["provenance"]["prior_sha256"]


def test_an_update_of_a_robot_that_lost_its_zeros_finds_them_and_asks_for_the_crash(folder):
    crashed = replace(ARM, lost_deg=(0.0, 0.2, 0.0))
    result = afterwards(folder, crashed, rows=30)
    assert list(result["loosened"]) == ["zeros"]
    assert max(result["noise_growth"]) == 1.0
    assert f"zeros × {result['loosened']['zeros']:.0f} (if something hit the robot" in result["sentence"]
    assert errors_of(folder, "new.json", crashed, drawn(np.random.default_rng(3), 40)).max() < 0.1


def test_nominal_and_the_prior_model_are_compared_with_in_sentence_table_and_json(folder, capsys):
    """The robot is as it was: an update has nothing to better, and says by what it was judged."""
    result = afterwards(folder, ARM, code=1)
    assert result["compared_with"] == "prior"
    assert result["sentence"].startswith("Error of held-out")
    assert "No better than the prior model: " in result["sentence"]
    assert result["test"]["mean"] < 1.5 * result["prior"]["mean"] < 0.1 * result["nominal"]["mean"] * 1.5
    table = capsys.readouterr().out
    assert "held out, nominal" in table
    assert "held out, prior model" in table


def test_another_robots_model_is_refused_as_prior(folder, capsys):
    (folder / "other.yaml").write_text(ELBOW_ROBOT.replace("a: 500,", "a: 501,").replace("sign: -1", "sign: 1"))
    assert cellctl("fit", "other.yaml", "before.csv", "--prior", "model.json") == 2
    said = capsys.readouterr().err
    assert "link table" in said
    assert "signs" in said


def test_freed_groups_alone_change_about_nominal_too(folder):
    (folder / "few.csv").write_text(measured(replace(ARM, tool=(12.0, -7.0, 30.0)), 20, 2))
    assert cellctl("fit", "robot.yaml", "few.csv", "--free", "zeros", "--json", "r.json") in (0, 1)
    result = json.loads((folder / "r.json").read_text())
    assert "links" not in result["groups"]
    assert [row["joint"] for row in result["mastering"]] == ["A1", "A2", "A3"]
