"""Rows without new information: copies, repeats, mistyped names, a robot or an instrument that never moved."""

import json
import math

import numpy as np
import pytest

from cellctl.calibration import Split
from cellctl.cli import exit_codes
from cellctl.cli.verbs import app
from tests.helpers.arms import ELBOW_ROBOT, ElbowArm, csv_text, drawn, joints_and_places

NOISE_MM = 0.02 / math.sqrt(3)
ARM = ElbowArm()
ANCHORS = {"bar": np.array([900.0, 0.0, 0.0]), "wire": np.array([200.0, 900.0, 0.0])}


@pytest.fixture
def fitted(tmp_path, monkeypatch):
    """Fits a data set of columns with `--model geometry`; exit code and JSON result, None where there is none."""
    (tmp_path / "robot.yaml").write_text(ELBOW_ROBOT)
    monkeypatch.chdir(tmp_path)

    def fit(columns, *options):
        (tmp_path / "data.csv").write_text(csv_text(columns))
        words = ["fit", "robot.yaml", "data.csv", "--model", "geometry", "--json", "r.json", *options]
        code = exit_codes.exit_code_of(lambda: app(words, standalone_mode=False))
        result = tmp_path / "r.json"
        return code, json.loads(result.read_text()) if result.exists() else None

    return fit


def positions(count, postures=None):
    """`count` positions, one after another at `postures` different ones."""
    rng = np.random.default_rng(1)
    readings = np.resize(drawn(rng, postures or count), (count, 3))
    return joints_and_places(readings, ARM.tcp(readings) + rng.normal(0, NOISE_MM, (count, 3)))


def distances(count=60):
    rng = np.random.default_rng(2)
    readings, names = drawn(rng, count), [list(ANCHORS)[row % 2] for row in range(count)]
    true = ElbowArm(at=(0.0, 0.0, 0.0)).tcp(readings)
    away = [float(np.linalg.norm(tip - ANCHORS[name])) for tip, name in zip(true, names, strict=True)]
    joints = {f"A{joint + 1}": readings[:, joint] for joint in range(3)}
    return {**joints, "anchor": names, "distance": np.array(away) + rng.normal(0, NOISE_MM, count)}


def test_a_number_that_cannot_be_costs_its_row_and_nothing_else(fitted):
    columns = positions(40)
    columns["Y"][7] = 1e300
    code, result = fitted(columns)
    assert (code, result["n_fit"]) == (0, 39)
    assert [row["line"] for row in result["rejected"]] == [9]


@pytest.mark.parametrize("name", ["wyre", "NaN"])
def test_a_mistyped_anchor_costs_its_row_and_nothing_else(fitted, capsys, name):
    columns = distances()
    columns["anchor"][7] = name
    code, result = fitted(columns)
    assert code == 0
    assert result["converged"]
    assert not result["test_outliers"]
    assert f"line 9: not used: the only row of anchor '{name}': mistyped?" in capsys.readouterr().err


def test_copies_of_one_row_are_one_row_and_refused_with_their_lines(fitted, capsys):
    code, result = fitted({name: [column[0]] * 40 for name, column in positions(1).items()})
    assert (code, result) == (2, None)
    said = capsys.readouterr().err
    assert "too few rows to fit where even the registration takes 4: 1\n" in said
    assert "data.csv:3: the same as line 2, number by number" in said


def test_one_posture_measured_again_and_again_is_refused(fitted, capsys):
    code, result = fitted(positions(40, postures=1))
    assert (code, result) == (2, None)
    assert "takes 4: 40, but 1 different" in capsys.readouterr().err


def test_touches_in_one_posture_accuse_no_joint(fitted, capsys):
    columns = {name: [column[0]] * 40 for name, column in distances().items()}
    columns["distance"] = [columns["distance"][0] + 0.01 * row for row in range(40)]
    code, result = fitted(columns)
    assert (code, result) == (2, None)
    said = capsys.readouterr().err
    assert ": 40, but 1 different" in said
    assert "swapped" not in said


@pytest.mark.parametrize("noise_mm", [0.0, NOISE_MM])
def test_an_instrument_that_sees_one_place_whatever_the_joints_is_refused(fitted, capsys, noise_mm):
    columns, rng = positions(40), np.random.default_rng(3)
    columns |= {name: columns[name][0] + rng.normal(0, noise_mm, 40) for name in "XYZ"}
    code, result = fitted(columns)
    assert (code, result) == (2, None)
    assert "X, Y, Z are the same place in all 40 rows" in capsys.readouterr().err


def test_four_positions_ten_times_each_prove_nothing(fitted, capsys):
    code, result = fitted(positions(40, postures=4))
    assert (code, result) == (2, None)
    assert "30 rows to fit in 3 postures where even the registration takes 4" in capsys.readouterr().err


def test_repeats_of_a_posture_do_not_judge_the_model_that_they_made(fitted):
    _, result = fitted(positions(50, postures=5))
    assert result["n_test"] == 50
    assert result["test"]["rms"] > 3 * result["fit"]["rms"]  # held out one by one they would be as good as those fitted


def test_sessions_of_the_same_postures_are_no_repeats_of_each_other(fitted):
    readings = drawn(np.random.default_rng(4), 10)
    rng, moved = np.random.default_rng(5), [ElbowArm(at=(100.0 * day, 0.0, 0.0)) for day in range(5)]
    places = np.concatenate([arm.tcp(readings) + rng.normal(0, NOISE_MM, (10, 3)) for arm in moved])
    columns = joints_and_places(np.tile(readings, (5, 1)), places)
    code, result = fitted({**columns, "session": [f"day {row // 10}" for row in range(50)]})
    assert code in (0, 1)
    assert result["n_test"] == 50


def test_groups_are_held_out_whole():
    groups = [row % 8 for row in range(40)]
    for split in (Split.folds(40, 5, 0, groups), Split.holdout(40, 0.3, 0, groups)):
        for fit, test in split.judged:
            assert not {groups[row] for row in fit} & {groups[row] for row in test}
            assert len(fit) + len(test) == 40
    assert sorted(row for _, test in Split.folds(40, 5, 0, groups).judged for row in test) == list(range(40))


def test_rows_without_repeats_are_split_as_if_nobody_had_looked():
    groups = list(range(7, 47))
    plain, grouped = (Split.folds(40, 5, 3), Split.folds(40, 5, 3, groups))
    assert [test.tolist() for _, test in plain.judged] == [test.tolist() for _, test in grouped.judged]
    assert Split.holdout(40, 0.3, 3).fit.tolist() == Split.holdout(40, 0.3, 3, groups).fit.tolist()
