"""The same robot, its instrument moved by metres: what it is compared with, and where it counts as measured."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from tests.helpers.arms import (
    ELBOW_LOWER,
    ELBOW_UPPER,
    ElbowArm,
    cellctl,
    csv_text,
    drawn,
    identified_elbow,
    joints_and_places,
)

NOISE_MM = 0.02 / math.sqrt(3)
THEN = ElbowArm()
NOW = replace(THEN, at=(3300.0, -2250.0, 690.0), turn_deg=55.0)
SPHERE = np.array([[1600.0, 170.0, 270.0]])


def measured(arm, readings, seed):
    rng = np.random.default_rng(seed)
    return csv_text(joints_and_places(readings, arm.tcp(readings) + rng.normal(0, NOISE_MM, (len(readings), 3))))


def on_the_left(count, seed):
    """Readings with A1 in the lower half of its range."""
    return np.random.default_rng(seed).uniform(ELBOW_LOWER, [-10.0, *ELBOW_UPPER[1:]], (count, 3))


def on_the_right(count, seed):
    """Readings with A1 in the upper half of its range."""
    return np.random.default_rng(seed).uniform([10.0, *ELBOW_LOWER[1:]], ELBOW_UPPER, (count, 3))


@pytest.fixture(scope="module")
def prior(tmp_path_factory):
    """A folder with `model.json`, measured on the left alone."""
    return identified_elbow(tmp_path_factory.mktemp("prior"), measured(THEN, on_the_left(60, 1), 1))


@pytest.fixture
def folder(prior, monkeypatch):
    monkeypatch.chdir(prior)
    return prior


def fitted(folder, text, *options, code=0):
    """The result and the model of a fit of `text` from the prior model."""
    (folder / "rows.csv").write_text(text)
    words = ["fit", "robot.yaml", "rows.csv", "--prior", "model.json", "--out", "new.json", "--json", "r.json"]
    assert cellctl(*words, *options) == code
    return json.loads((folder / "r.json").read_text()), json.loads((folder / "new.json").read_text())


def region_of(folder):
    return json.loads((folder / "model.json").read_text())["joint_region"]


def test_a_base_found_anew_leaves_the_measured_region_and_its_warning(folder, capsys):
    result, model = fitted(folder, measured(NOW, on_the_right(30, 2), 2), "--free", "base")
    assert model["joint_region"] == region_of(folder)
    assert result["informed"] is False
    assert "measured region is still that of the prior model" in capsys.readouterr().out
    (folder / "asked.csv").write_text("A1,A2,A3\n60,-30,-60\n")
    assert cellctl("predict", "new.json", "asked.csv", "-o", "tcp.csv") == 0
    assert "1 of 1 rows lie outside" in capsys.readouterr().err
    older = json.loads((folder / "model.json").read_text())["figures"]["predicted_volumetric_rms"]
    assert result["predicted_volumetric_rms"] == pytest.approx(older, rel=0.05)


def test_where_the_prior_model_stood_is_neither_baseline_nor_sigma(folder):
    result, _ = fitted(folder, measured(NOW, on_the_right(30, 2), 2), "--free", "base")
    assert result["prior_as_is_rms"] > 2000.0
    assert result["nominal"]["max"] < 2.0
    assert result["prior"] == pytest.approx(result["test"], rel=1e-3)
    assert result["predicted_test_rms"] < 2.0 * result["nominal"]["rms"]
    assert result["sentence"].startswith("Error of held-out")
    assert "Better than nominal, no worse than the prior model." in result["sentence"]
    assert "moved since the prior model" in result["sentence"]


def test_a_prior_model_alone_recognises_a_moved_instrument_and_agrees_with_free_base(folder):
    text = measured(NOW, drawn(np.random.default_rng(4), 20), 4)
    alone, freed = (fitted(folder, text, *options)[0] for options in ((), ("--free", "base")))
    assert alone["verdict"] == freed["verdict"] == "better"
    assert freed["compared_with"] == "nominal"
    for result in (alone, freed):
        assert "Instrument moved since the prior model: it was set up again (base 331" in result["sentence"]
        assert "55.0" in result["sentence"]
        assert "the tool is as it was" in result["sentence"]
    assert alone["test"]["mean"] < 1.5 * freed["test"]["mean"]


@pytest.mark.long
def test_a_tool_that_changed_with_the_instrument_is_named_where_only_the_base_was_freed(folder):
    text = measured(replace(NOW, tool=(40.0, -7.0, 60.0)), drawn(np.random.default_rng(4), 20), 4)
    held = fitted(folder, text, "--free", "base", code=1)[0]
    assert held["verdict"] == "worse"
    assert "The tool changed too: --free base,tool explains the rows" in held["sentence"]
    both = fitted(folder, text, "--free", "base,tool")[0]
    assert both["verdict"] == "better"
    assert "Instrument or robot, and tool, moved since the prior model" in both["sentence"]
    assert "explains the rows" not in both["sentence"]


def test_a_tool_that_changed_alone_is_reported_as_that(folder):
    text = measured(replace(THEN, tool=(40.0, -7.0, 60.0)), drawn(np.random.default_rng(4), 20), 4)
    assert "The tool changed since the prior model (" in fitted(folder, text)[0]["sentence"]


def test_an_update_by_many_rows_elsewhere_extends_the_measured_region(folder):
    result, model = fitted(folder, measured(NOW, on_the_right(60, 5), 5))
    assert result["informed"] is True
    assert model["joint_region"]["max"][0] > 80.0
    assert model["joint_region"]["min"][0] == region_of(folder)["min"][0]


def test_zeros_lost_where_the_instrument_stayed_are_compared_with_the_prior_model_as_it_was(folder):
    """A1's own zero is a turn of the base to every row: registering the base would hide what was found."""
    result, model = fitted(
        folder, measured(replace(THEN, lost_deg=(0.7, 0.0, 0.0)), on_the_right(12, 6), 6), "--free", "zeros"
    )
    assert result["compared_with"] == "both"
    assert result["prior"]["mean"] > 5.0
    assert abs(result["mastering"][0]["offset_deg"] - 0.7) < 0.01
    assert model["joint_region"]["max"][0] > 60.0


def test_a_group_freed_in_place_of_the_base_is_worse_than_nominal_and_says_what_to_do(folder):
    result, _ = fitted(folder, measured(NOW, on_the_left(20, 7), 7), "--free", "tool", code=1)
    assert result["verdict"] == "worse"
    assert "if the instrument was moved, leave --free out" in result["sentence"]


def test_touches_on_a_sphere_nobody_knows_leave_the_measured_region_where_only_the_tool_is_new(folder):
    tooled = replace(THEN, tool=(12.0, -7.0, 30.0))
    rng = np.random.default_rng(8)
    away = rng.normal(size=(14, 3))
    readings = tooled.reaching(SPHERE + 31.0 * away / np.linalg.norm(away, axis=1)[:, None], rng)
    columns = {**{f"A{j + 1}": readings[:, j] for j in range(3)}, "sphere": ["S"] * 14}
    sphere = "{id: S, diameter: 60, centre: [1600, 170, 270]}"
    (folder / "artefact.yaml").write_text(f"tip_radius: 1.0\nspheres:\n  - {sphere}\n")
    result, model = fitted(folder, csv_text(columns), "--free", "tool", "--artefact", "artefact.yaml")
    assert model["joint_region"] == region_of(folder)
    assert result["prior_as_is_rms"] is None
    assert result["compared_with"] == "both"
