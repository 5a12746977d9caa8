"""Models on the same rows and folds: the table's figures are those of each fit, and intervals allow for overlap."""

import json

import numpy as np
import pytest

from cellctl.calibration import Split
from cellctl.calibration.verdict.comparison import Difference
from tests.helpers import arms
from tests.helpers.arms import cellctl, csv_text, drawn, joints_and_places, printed_errors


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("compared")
    (folder / "robot.yaml").write_text(arms.ELBOW_ROBOT)
    rng = np.random.default_rng(3)
    readings = drawn(rng, 60)
    places = arms.ElbowArm(upper=502.0).tcp(readings) + rng.normal(0.0, 0.02, (60, 3))
    (folder / "data.csv").write_text(csv_text(joints_and_places(readings, places)))
    return folder


def compared(folder, *words):
    out = folder / "compared.json"
    code = cellctl("fit", folder / "robot.yaml", folder / "data.csv", *words, "--json", out)
    return code, json.loads(out.read_text())


@pytest.mark.long
def test_each_model_has_the_figures_of_its_own_fit(files):
    code, found = compared(files, "--compare", "registration", "--compare", "geometry+idw", "--folds", 4)
    assert code == 0
    assert [row["choice"] for row in found["models"]] == ["auto", "registration", "geometry+idw"]
    for row in found["models"]:
        own = files / "own.json"
        cellctl("fit", files / "robot.yaml", files / "data.csv", "--model", row["choice"], "--folds", 4, "--json", own)
        alone = json.loads(own.read_text())
        assert row["test"] == alone["test"]
        assert row["coverage_95"] == alone["coverage_95"]
        assert row["predicted_rms"] == alone["predicted_test_rms"]
    auto, registration, _ = found["models"]
    assert auto["less"] is None
    assert registration["less"]["low"] > 0.0
    assert " leaves the least on 60 held-out positions" in found["sentence"]


def test_the_page_has_every_model(files):
    page = files / "page.html"
    compared(files, "--compare", "registration", "--holdout", 0.3, "--report", page)
    text = page.read_text()
    assert "registration" in text
    assert text.count("<svg") == 2  # one split has no picture of folds


def test_one_held_out_row_has_no_interval(files):
    out = files / "one.json"
    words = ("fit", files / "robot.yaml", files / "data.csv", "--compare", "registration", "--holdout", 0.02)
    cellctl(*words, "--json", out)
    assert "Infinity" not in out.read_text()
    assert [row["less"] for row in json.loads(out.read_text())["models"]] == [None, None]


REFUSED = {
    ("--compare", "geometry", "--out", "m.json"): "a comparison writes no model",
    ("--compare", "geometry", "--model", "zeros"): "does not go with --model, --prior, --prior-of-type or --free",
    ("--compare", "nothing"): "'nothing' is not known",
}


@pytest.mark.parametrize("words", REFUSED)
def test_what_does_not_go_together_is_refused(words, files, capsys, monkeypatch):
    monkeypatch.chdir(files)
    assert cellctl("fit", "robot.yaml", "data.csv", *words) == 2
    assert REFUSED[words] in printed_errors(capsys)


@pytest.mark.long
def test_a_model_that_cannot_be_fitted_is_named(files, capsys):
    (files / "few.csv").write_text("".join((files / "data.csv").read_text().splitlines(keepends=True)[:11]))
    assert cellctl("fit", files / "robot.yaml", files / "few.csv", "--compare", "kriging", "--folds", 5) == 2
    assert "--compare: kriging: 8 samples: an error map needs at least 10" in printed_errors(capsys)


def test_folds_without_a_difference_are_rarely_decided():
    """Two predictors (mean and median of the training rows) that are equally good: their folds overlap."""
    decided = naive = 0
    for seed in range(400):
        rng = np.random.default_rng(seed)
        values, split = rng.normal(size=60), Split.folds(60, 5, seed)
        pairs = [
            (np.abs(values[test] - values[fit].mean()), np.abs(values[test] - np.median(values[fit])))
            for fit, test in split.judged
        ]
        a, b = (np.concatenate(each) for each in zip(*pairs, strict=True))
        decided += Difference.of(a, b, split).decided
        one = Split.by_column(np.ones(60, bool))
        naive += Difference.of(a, b, one).decided
    assert decided <= 0.06 * 400 < naive


def test_one_row_decides_nothing():
    split = Split.by_column(np.array([False, True]))
    found = Difference.of(np.array([1.0]), np.array([0.5]), split)
    assert (found.mean, found.decided) == (-0.5, False)
