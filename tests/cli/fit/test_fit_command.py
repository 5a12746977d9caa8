"""`cellctl fit` and `cellctl predict` as a person or a script calls them: exit codes, JSON, files, refusals."""

import csv
import json
import os
import stat

import numpy as np
import pytest

from cellctl.formats import ModelFile

KEYS = {
    "n_fit", "n_test", "model", "n_parameters", "rank", "unobservable", "outliers", "nominal", "fit", "test",
    "predicted_test_rms", "coverage_95", "verdict", "seconds", "verdict_reason", "predicted_volumetric_rms",
    "test_outliers",
}  # fmt: skip


def fitted(cellctl, files, *options, data="positions.csv", code=0):
    assert cellctl("fit", "robot.yaml", data, "--json", "result.json", *options) == code
    return json.loads((files / "result.json").read_text())


def test_a_better_robot_ends_with_0_and_the_promised_keys(cellctl, files, capsys):
    result = fitted(cellctl, files)
    assert set(result) >= KEYS
    assert (result["n_fit"], result["n_test"], result["verdict"]) == (40, 20, "better")
    assert result["test"]["mean"] < 0.06 < 0.2 < result["nominal"]["mean"]
    assert " Better than nominal. " in capsys.readouterr().out.splitlines()[-1]


@pytest.mark.long
def test_the_same_seed_gives_the_same_bytes_and_another_seed_holds_out_others(cellctl, files):
    results = []
    for seed in (1, 1, 2):
        result = fitted(cellctl, files, "--holdout", "0.3", "--seed", seed, "--out", f"model{len(results)}.json")
        result.pop("seconds")
        results.append(json.dumps(result))
    assert results[0] == results[1] != results[2]
    assert (files / "model0.json").read_bytes() == (files / "model1.json").read_bytes()


def test_json_to_stdout_is_json_and_nothing_else(cellctl, files, capsys):
    assert cellctl("fit", "robot.yaml", "positions.csv", "--json", "-") == 0
    assert json.loads(capsys.readouterr().out)["verdict"] == "better"


@pytest.mark.long
def test_without_a_set_column_every_row_is_judged_by_folds(cellctl, files):
    text = (files / "positions.csv").read_text()
    (files / "bare.csv").write_text("\n".join(line.rsplit(",", 1)[0] for line in text.splitlines()))
    result = fitted(cellctl, files, data="bare.csv")
    assert result["n_fit"] == result["n_test"] == 60


@pytest.mark.long
def test_touches_use_the_artefact_with_or_without_its_distances(cellctl, files):
    with_distances = fitted(cellctl, files, "--artefact", "artefact.yaml", data="touches.csv")
    without = fitted(cellctl, files, "--artefact", "artefact.yaml", "--no-distances", data="touches.csv")
    assert with_distances["measure"] == without["measure"] == "sphere"
    assert with_distances["test"]["mean"] < 0.02
    assert with_distances["test"] != without["test"]


def test_a_robot_that_is_as_its_file_says_gets_no_praise(cellctl, files):
    exact = (files / "robot.yaml").read_text().replace("a: 500,", "a: 500.8,").replace("d: 0, a: 450", "d: 0, a: 449.3")
    (files / "robot.yaml").write_text(exact.replace("{theta: 0, d: 0,", "{theta: 0.03, d: 0,"))
    result = fitted(cellctl, files, code=1)
    assert result["verdict"] != "better"


def test_an_unusable_row_is_named_on_stderr_and_in_the_json(cellctl, files, capsys):
    lines = (files / "positions.csv").read_text().splitlines()
    lines[9] = lines[9].replace(lines[9].split(",")[4], "n/a")
    (files / "positions.csv").write_text("\n".join(lines))
    result = fitted(cellctl, files)
    assert [row["line"] for row in result["rejected"]] == [10]
    assert "line 10: not used: Y 'n/a' is not a number" in capsys.readouterr().err


def test_an_outlier_is_left_out_and_named(cellctl, files):
    rows = list(csv.reader((files / "positions.csv").open()))
    rows[5][3] = str(float(rows[5][3]) + 4.0)
    (files / "positions.csv").write_text("\n".join(",".join(row) for row in rows))
    result = fitted(cellctl, files)
    assert [row["line"] for row in result["outliers"]] == [6]
    assert "left out" in result["outliers"][0]["reason"]
    assert result["n_fit"] == 39


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--model", "geometry+backlash"], "D1…Dn"),
        (["--model", "geometry+growth"], "temperature"),
        (["--model", "geometry+deflection"], "mass"),
        (["--model", "geometry+warp"], "'warp' is not known"),
        (["--model", "geometry+zeros"], "holds the zeros"),
        (["--model", "auto+compliance"], "alone"),
        (["--model", "geometry", "--free", "zeros"], "does not go with --free"),
        (["--free", "zeros,compliance"], "no group 'compliance'"),
        (["--own", "flange"], "--own"),
        (["--spacing", "A,B=50"], "50±0.01"),
        (["--spacing", "A,B=50±0.01"], "no point 'A'"),
        (["--by", "session"], "no column 'session'"),
        (["--by", "X"], "it is a number"),
        (["--by", "set", "--folds", "3"], "one of"),
        (["--measure", "socket"], "socket"),
        (["--measure", "speed"], "--measure"),
        (["--prior", "old.json"], "old.json: cannot be read"),
        (["--holdout", "1.5"], "--holdout"),
        (["--folds", "1"], "--folds"),
        (["--folds", "61"], "61 folds, but the data set has 60 usable rows"),
        (["--folds", "3", "--holdout", "0.2"], "one of"),
        (["--column", "who"], "--column"),
        (["--holdout", "0.97"], "rows to fit"),
        (["--measure", "sphere"], "sphere"),
        (["--measure", "pose"], "orientation"),
    ],
)
def test_an_option_that_cannot_be_met_is_refused_with_2(cellctl, files, capsys, options, words):
    assert cellctl("fit", "robot.yaml", "positions.csv", *options, "--out", "model.json") == 2
    assert words in capsys.readouterr().err
    assert not (files / "model.json").exists()


def test_errors_in_robot_and_data_come_together(cellctl, files, capsys):
    (files / "robot.yaml").write_text("name: 3\n")
    (files / "positions.csv").write_text("")
    assert cellctl("fit", "robot.yaml", "positions.csv") == 2
    said = capsys.readouterr().err
    assert "robot.yaml:1" in said
    assert "positions.csv: is empty" in said


@pytest.mark.skipif(os.geteuid() == 0, reason="the superuser may read everything")
def test_a_file_without_read_access_is_refused(cellctl, files, capsys):
    (files / "positions.csv").chmod(stat.S_IWUSR)
    assert cellctl("fit", "robot.yaml", "positions.csv") == 2
    assert "cannot be read" in capsys.readouterr().err


def test_the_written_model_is_the_identified_robot(cellctl, files):
    fitted(cellctl, files, "--out", "model.json")
    model = ModelFile.load(files / "model.json")
    found = {parameter.name: parameter for parameter in model.parameters}
    assert abs(found["a2"].value - 0.8) < 4 * found["a2"].sigma + 0.05
    assert found["a2"].sigma < found["a2"].prior_sigma == 0.5
    assert model.text() == (files / "model.json").read_text()
    assert len(model.provenance["data_sha256"]) == 64


def test_predictions_meet_the_measurements_within_their_sigma_and_tell_extrapolation(cellctl, files, capsys):
    fitted(cellctl, files, "--out", "model.json")
    capsys.readouterr()
    far = "".join(f"{','.join(line.split(',')[:3])}\n" for line in (files / "positions.csv").read_text().splitlines())
    (files / "joints.csv").write_text(far + "170,5,-20\n")
    assert cellctl("predict", "model.json", "joints.csv", "-o", "tcp.csv") == 0
    said = list(csv.DictReader((files / "tcp.csv").open()))
    measured = list(csv.DictReader((files / "positions.csv").open()))
    assert len(said) == len(measured) + 1
    errors = [[float(a[k]) - float(b[k]) for k in "XYZ"] for a, b in zip(said, measured, strict=False)]
    assert np.sqrt(np.mean(np.sum(np.square(errors), axis=1))) < 0.06
    assert all(0 < float(row["sigma"]) < 0.2 for row in said[:-1])
    assert float(said[-1]["sigma"]) > 1.5 * max(float(row["sigma"]) for row in said[:-1])  # a joint 80° outside
    true = [81.2279, 182.0043, 297.5875]  # `tip(170, 5, -20)` in the frame of the instrument
    off = np.linalg.norm([float(said[-1][axis]) - value for axis, value in zip("XYZ", true, strict=True)])
    assert off < 3.0 * float(said[-1]["sigma"])
    assert [row["seen"] for row in said[-2:]] == ["1", "0"]
    assert "1 of 61 rows" in capsys.readouterr().err


def test_predict_refuses_a_bad_row_rather_than_shift_the_others(cellctl, files, capsys):
    fitted(cellctl, files, "--out", "model.json")
    (files / "joints.csv").write_text("A1,A2,A3\n1,2,3\n1,x,3\n1,2\n")
    assert cellctl("predict", "model.json", "joints.csv") == 2
    said = capsys.readouterr().err
    assert "joints.csv:3" in said
    assert "joints.csv:4" in said


@pytest.mark.parametrize("content", ["", "{}", "[1]", '{"format": "cellctl model 2"}', "\xff"])
def test_a_file_that_is_no_model_is_refused(cellctl, files, capsys, content):
    (files / "model.json").write_text(content, encoding="latin-1")
    assert cellctl("predict", "model.json", "positions.csv") == 2
    assert "no model file" in capsys.readouterr().err


def test_a_model_whose_parameters_are_another_robots_is_refused(cellctl, files, capsys):
    fitted(cellctl, files, "--out", "model.json")
    content = json.loads((files / "model.json").read_text())
    content["parameters"].pop()
    (files / "model.json").write_text(json.dumps(content))
    assert cellctl("predict", "model.json", "positions.csv") == 2
    assert "parameters" in capsys.readouterr().err


def test_a_held_out_outlier_is_named_and_counted(cellctl, files, capsys):
    rows = list(csv.reader((files / "positions.csv").open()))
    rows[50][3] = str(float(rows[50][3]) + 4.0)
    (files / "positions.csv").write_text("\n".join(",".join(row) for row in rows))
    assert cellctl("fit", "robot.yaml", "positions.csv", "--json", "result.json") in (0, 1)
    result = json.loads((files / "result.json").read_text())
    assert [row["line"] for row in result["test_outliers"]] == [51]
    assert result["test"]["max"] > 3.0
    assert "(line 51)" in result["sentence"]
    assert "line 51: held out: error" in capsys.readouterr().err


def test_with_nothing_held_out_no_figure_stands_in_its_place(cellctl, files, capsys):
    text = (files / "positions.csv").read_text().replace(",test", ",fit")
    (files / "positions.csv").write_text(text)
    assert fitted(cellctl, files, code=1)["verdict_reason"] == "no row was held out"
    said = capsys.readouterr().out.splitlines()
    assert [line.split()[-3:] for line in said if line.startswith("held out")] == [["–"] * 3] * 2


def test_scatter_beyond_what_the_robot_file_says_is_reported(cellctl, files):
    boastful = (files / "robot.yaml").read_text().replace("repeatability: 0.03", "repeatability: 0.003")
    (files / "robot.yaml").write_text(boastful)
    assert "times more than the robot file states" in fitted(cellctl, files)["sentence"]


@pytest.mark.long
def test_predicted_points_among_themselves_are_surer_than_in_a_frame_that_nobody_saw(cellctl, files):
    fitted(cellctl, files, "--artefact", "artefact.yaml", "--out", "model.json", data="touches.csv")
    assert cellctl("predict", "model.json", "touches.csv", "-o", "tcp.csv") == 0
    rows = list(csv.DictReader((files / "tcp.csv").open()))
    assert all(0.0 < float(row["sigma_among"]) < 0.5 * float(row["sigma"]) for row in rows)
    (files / "three.csv").write_text("\n".join((files / "touches.csv").read_text().splitlines()[:4]))
    assert cellctl("predict", "model.json", "three.csv", "-o", "tcp.csv") == 0
    assert {row["sigma_among"] for row in csv.DictReader((files / "tcp.csv").open())} == {""}


@pytest.mark.long
def test_a_page_is_written_where_it_is_asked_for(cellctl, files):
    result = fitted(cellctl, files, "--report", "fit.html")
    page = (files / "fit.html").read_text(encoding="utf-8")
    assert page.startswith("<!DOCTYPE html>")
    assert result["sentence"] in page
    assert "What to measure next" in page
    assert "positions.csv, SHA-256" in page


def test_robot_file_and_data_set_in_the_wrong_order_are_recognised(cellctl, files, capsys):
    assert cellctl("fit", "positions.csv", "robot.yaml") == 2
    said = capsys.readouterr().err
    assert "cellctl: 1 error\npositions.csv: is taken for the robot file" in said
    assert "cellctl fit robot.yaml positions.csv" in said
