"""Bad input of a fit: it is refused, or the bad rows are named; no figure looks better than it is."""

import csv
import json
import os
import re
import resource
import signal
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

GEOMETRY = ("--model", "geometry")
WHAT_NO_ROBOT_IS_MEASURED_BY = ["nan", "inf", "-1e400", "1e300", "text", "0x10", "1_000", ""]


@pytest.fixture
def rows(files):
    """The rows of a data set as dicts of texts."""

    def read(name="positions.csv"):
        with (files / name).open(newline="") as source:
            return list(csv.DictReader(source))

    return read


@pytest.fixture
def fit(cellctl, files):
    """Fits rows (dicts): the exit code, and the JSON result or None where nothing was written."""

    def fitted(table, *options, robot="robot.yaml", model=GEOMETRY):
        with (files / "bad.csv").open("w", newline="") as target:
            writer = csv.DictWriter(target, list(dict.fromkeys(name for row in table for name in row)), restval="")
            writer.writeheader()
            writer.writerows(table)
        made = ("--json", "bad.json", "--out", "bad-model.json")
        code = cellctl("fit", robot, "bad.csv", *model, *made, *options)
        written = [path for path in made[1::2] if (files / path).exists()]
        assert len(written) in ((0,) if code == 2 else (2,))
        return code, json.loads((files / "bad.json").read_text()) if written else None

    return fitted


@pytest.fixture
def identified(cellctl, files, capsys):
    """The text of a model of the positions."""
    assert cellctl("fit", "robot.yaml", "positions.csv", *GEOMETRY, "--out", "model.json") == 0
    capsys.readouterr()
    return (files / "model.json").read_text()


def without_set(table):
    return [{name: text for name, text in row.items() if name != "set"} for row in table]


def pushed(table, which, by, axes="XYZ"):
    """Rows `which` (from 0) of `table` moved by `by` (N, 3), mm."""
    for row, push in zip(which, by, strict=True):
        for axis, along in zip(axes, push, strict=True):
            table[row][axis] = str(float(table[row][axis]) + along)
    return table


@pytest.mark.parametrize("text", WHAT_NO_ROBOT_IS_MEASURED_BY)
@pytest.mark.parametrize("column", ["Y", "A2"])
def test_a_cell_that_is_no_measurement_costs_its_row_alone_and_is_named(fit, rows, column, text):
    table = rows()
    table[7][column] = text
    code, result = fit(table)
    assert code == 0
    assert [row["line"] for row in result["rejected"]] == [9]
    assert column in result["rejected"][0]["reason"]
    assert result["n_fit"] == 39
    assert result["test"]["mean"] < 0.06


@pytest.mark.parametrize(("column", "text"), [("radius", "1e6"), ("radius", "-30"), ("tip_radius", "1e300")])
def test_a_size_beyond_all_measure_costs_its_touch_alone(fit, rows, column, text):
    table = [row | {"radius": "30", "tip_radius": "1"} for row in rows("touches.csv")]
    table[7][column] = text
    code, result = fit(table)
    assert code == 0
    assert [row["line"] for row in [*result["rejected"], *result["outliers"]]] == [9]


@pytest.mark.parametrize("sigma", ["0", "-0.1", "1e-12", "1e-300", "4e5", "1e300", "nan"])
def test_a_standard_deviation_that_nothing_has_costs_its_row_alone(fit, rows, sigma):
    table = [row | {"sX": "0.017", "sY": "0.017", "sZ": "0.017"} for row in rows()]
    table[7]["sX"] = sigma
    code, result = fit(table)
    assert code == 0
    assert [row["line"] for row in result["rejected"]] == [9]
    assert "sX" in result["rejected"][0]["reason"]


@pytest.mark.parametrize(
    ("column", "text"), [("temperature", "5000"), ("temperature", "-300"), ("payload", "1e5"), ("payload", "-1")]
)
def test_a_condition_that_no_robot_works_in_costs_its_row_alone(fit, rows, column, text):
    table = [row | {"temperature": "21.5", "payload": "2"} for row in rows()]
    table[7][column] = text
    code, result = fit(table)
    assert code == 0
    assert [row["line"] for row in result["rejected"]] == [9]
    assert column in result["rejected"][0]["reason"]


@pytest.mark.parametrize("change", [lambda line: line + ",1", lambda line: line.rsplit(",", 1)[0]])
def test_a_line_with_a_wrong_number_of_cells_is_named(cellctl, files, capsys, change):
    lines = (files / "positions.csv").read_text().splitlines()
    lines[8] = change(lines[8])
    (files / "positions.csv").write_text("\n".join(lines))
    assert cellctl("fit", "robot.yaml", "positions.csv", *GEOMETRY) == 0
    assert "line 9: not used: " in capsys.readouterr().err


@pytest.mark.parametrize("content", [b"", b"\n\n", b"\xef\xbb\xbf", b"A1,A2,A3,X,Y,Z\n", b"\x89PNG\x00\x01", b"\xff"])
def test_a_file_without_measurements_is_refused(cellctl, files, capsys, content):
    (files / "positions.csv").write_bytes(content)
    assert cellctl("fit", "robot.yaml", "positions.csv") == 2
    assert "positions.csv" in capsys.readouterr().err


@pytest.mark.parametrize("count", [1, 2, 3])
def test_a_few_rows_are_no_data_set(fit, rows, capsys, count):
    assert fit(without_set(rows())[:count]) == (2, None)
    assert "registration takes" in capsys.readouterr().err


@pytest.mark.parametrize("data", ["positions.csv", "touches.csv"])
def test_rows_that_are_all_alike_are_refused(fit, rows, capsys, data):
    row = rows(data)[0] | ({"radius": "30"} if data == "touches.csv" else {"set": ""})
    assert fit([row] * 40) == (2, None)
    said = capsys.readouterr().err
    assert "swapped" not in said
    assert "reversed" not in said


@pytest.mark.parametrize("alike", [("A1", "A2", "A3"), ("X", "Y", "Z")])
def test_one_posture_in_many_places_and_one_place_in_many_postures_are_refused(fit, rows, alike):
    table = rows()
    first = {name: table[0][name] for name in alike}
    assert fit([row | first for row in without_set(table)]) == (2, None)


@pytest.mark.parametrize("count", [4, 6, 8])
def test_copies_of_rows_do_not_judge_the_rows_that_they_are_copies_of(fit, rows, count):
    code, result = fit(without_set(rows())[:count] * 10)
    assert code != 0 or result["n_fit"] == count


def test_a_wrong_name_of_a_sphere_in_one_row_costs_that_row_alone(fit, rows):
    table = [row | {"radius": "30", "tip_radius": "1"} for row in rows("touches.csv")]
    table[7]["sphere"] = "Sl"
    code, result = fit(table)
    assert code == 0
    named = [*result["rejected"], *result["outliers"], *result["test_outliers"]]
    assert {row["line"] for row in named} == {9}


def test_three_outliers_in_forty_are_named_and_no_others(fit, rows):
    outlying = [4, 17, 30]
    code, result = fit(pushed(rows(), outlying, np.random.default_rng(1).normal(0, 2.0, (3, 3))))
    assert code == 0
    assert [row["line"] for row in result["outliers"]] == [6, 19, 32]
    assert result["test_outliers"] == []
    assert result["test"]["mean"] < 0.06


@pytest.mark.long
@pytest.mark.parametrize(
    ("share", "size_mm"), [(0.25, 0.3), (0.25, 2.0), (0.4, 0.3), (0.4, 1.0), (0.4, 20.0), (0.6, 1.0), (0.6, 20.0)]
)
def test_a_data_set_of_many_outliers_is_never_called_better(fit, rows, share, size_mm):
    rng = np.random.default_rng([int(100 * share), int(10 * size_mm)])
    outlying = rng.choice(60, round(share * 60), replace=False)
    code, result = fit(pushed(rows(), outlying, rng.normal(0, size_mm, (len(outlying), 3))))
    assert code == 1
    assert result["verdict"] != "better"
    assert result["test"]["rms"] > 0.3 * size_mm * share


def test_rows_that_mostly_scatter_more_than_was_said_are_judged_by_how_they_scatter(fit, rows):
    """Most rows wild by no more than the robot is wrong: a noisy instrument, from which a robot can be identified."""
    rng = np.random.default_rng([60, 3])
    outlying = rng.choice(60, 36, replace=False)
    _, result = fit(pushed(rows(), outlying, rng.normal(0, 0.3, (36, 3))))
    assert min(result["noise_growth"]) > 8.0
    assert "times more than the robot file states" in result["sentence"]
    assert result["test"]["rms"] > 0.3
    assert 0.75 < result["predicted_test_rms"] / result["test"]["rms"] < 1.5


@pytest.mark.parametrize(("factor", "count"), [(1e-3, 20), (1 / 25.4, 10)])
def test_rows_in_another_unit_than_the_others_are_never_called_better(fit, rows, factor, count):
    table = rows()
    for row in table[:count]:
        row |= {axis: str(float(row[axis]) * factor) for axis in "XYZ"}
    code, result = fit(table, "--no-check")
    assert code == 1
    assert result["verdict"] != "better"


def test_degrees_in_columns_of_radians_are_reported_as_such(fit, rows, capsys):
    table = [{name.replace("A", "q"): text for name, text in row.items()} for row in rows()]
    assert fit(table) == (2, None)
    assert "degrees" in capsys.readouterr().err


def test_an_orientation_given_in_two_ways_is_refused(fit, rows, capsys):
    both = {"A": "0", "B": "0", "C": "0", "QW": "1", "QX": "0", "QY": "0", "QZ": "0"}
    assert fit([row | both for row in rows()]) == (2, None)
    assert "two ways" in capsys.readouterr().err


def test_a_touch_nearer_than_the_centre_is_named(fit, rows):
    table = [row | {"radius": "30", "tip_radius": "1", "drift": "0"} for row in rows("touches.csv")]
    table[7]["drift"] = "-40"
    code, result = fit(table)
    assert code == 0
    assert [row["line"] for row in result["rejected"]] == [9]


def test_where_nothing_was_held_out_no_figure_of_held_out_rows_is_in_the_json(fit, rows):
    code, result = fit([row | {"set": "fit"} for row in rows()])
    assert code == 1
    assert result["n_test"] == 0
    assert {result["test"][name] for name in ("mean", "rms", "max")} == {None}
    assert result["predicted_test_rms"] is None


def test_the_error_told_of_a_held_out_row_is_its_held_out_error(fit, rows):
    table = without_set(rows())
    pushed(table, [7], [[0.0, 900.0, 0.0]])
    _, result = fit(table)
    of_wild_row = [row["reason"] for row in result["test_outliers"] if row["line"] == 9]
    assert len(of_wild_row) == 1
    assert f"error {result['test']['max']:.3f} mm" in of_wild_row[0]


def test_what_was_predicted_of_a_held_out_row_is_of_that_row(fit, rows):
    """Rows of two instruments, one a hundred times better than the other: each is held to its own σ."""
    table = without_set(rows())
    for number, row in enumerate(table):
        row |= dict.fromkeys(("sX", "sY", "sZ"), "1.7" if number % 2 else "0.017")
    pushed(table, [7, 8], [[0.0, 90.0, 0.0], [0.0, 9.0, 0.0]])
    _, result = fit(table)
    reasons = {row["line"]: row["reason"] for row in result["test_outliers"]}
    foreseen = {line: float(reasons[line].split("predicted ")[1].split(" mm")[0]) for line in (9, 10)}
    assert 1.7 < foreseen[9] < 6.0
    assert 0.017 < foreseen[10] < 0.2


def test_what_a_model_without_links_cannot_express_is_scatter_in_its_sigma(fit, rows):
    said = "count as scatter, which is in this σ"
    _, zeros = fit(rows(), model=("--model", "zeros"))
    assert 0.8 < zeros["predicted_volumetric_rms"] / zeros["test"]["rms"] < 1.5
    assert said in zeros["sentence"]
    _, geometry = fit(rows())
    assert said not in geometry["sentence"]


def test_a_robot_file_and_a_data_set_may_be_pipes(cellctl, files):
    """Each is read once: a second look would wait for ever, or see another file."""
    for name in ("robot.yaml", "positions.csv"):
        text = (files / name).read_text()
        (files / name).unlink()
        os.mkfifo(files / name)
        threading.Thread(target=(files / name).write_text, args=(text,), daemon=True).start()
    assert cellctl("fit", "robot.yaml", "positions.csv", *GEOMETRY) == 0


def test_a_narrow_terminal_folds_lines_and_cuts_no_figure(cellctl, monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", "12")
    assert cellctl("fit", "robot.yaml", "positions.csv", *GEOMETRY) == 0
    said = capsys.readouterr().out
    assert "…" not in said
    assert re.search(r"held out, identified +0\.0\d\d +0\.0\d\d +0\.0\d\d", said)


@pytest.mark.long
def test_names_of_files_that_are_no_text_end_nothing(cellctl, files):
    strange = os.fsdecode(b"r\xff.csv")
    (files / strange).write_bytes((files / "positions.csv").read_bytes())
    written = ("--out", os.fsdecode(b"m\xff"), "--report", os.fsdecode(b"p\xff"), "--json", os.fsdecode(b"j\xff"))
    assert cellctl("fit", "robot.yaml", strange, *GEOMETRY, *written) == 0
    assert all((files / name).exists() for name in written[1::2])


def _covariance(change):
    def edited(model):
        change(np.array(model["covariance"]), model["covariance"])

    return edited


def _negative(_, cells):
    cells[7][7] = -cells[7][7]


def _lopsided(_, cells):
    cells[7][8] += 1e-3


def _impossible(values, cells):
    cells[7][8] = cells[8][7] = 10.0 * float(np.sqrt(values[7, 7] * values[8, 8]) + 1e-3)


EDITS = {
    "a negative variance": _covariance(_negative),
    "a covariance that is not symmetric": _covariance(_lopsided),
    "a correlation of 10": _covariance(_impossible),
    "a covariance that is not a number": _covariance(lambda _, cells: cells[7].__setitem__(7, float("nan"))),
    "a variance of 1e300": _covariance(lambda _, cells: cells[7].__setitem__(7, 1e300)),
    "a parameter of 1e300 mm": lambda model: model["parameters"][8].update(value=1e300),
    "a region of one joint": lambda model: model["joint_region"].update(min=[1.0]),
    "a region upside down": lambda model: model["joint_region"].update(
        min=model["joint_region"]["max"], max=model["joint_region"]["min"]
    ),
    "no start of the tool": lambda model: model["start"].pop("tool"),
    "a doubt below zero": lambda model: model.update(outside_mm=-5.0),
    "a σ unlike its variance": lambda model: model["parameters"][8].update(sigma=7.0),
    "a newer format": lambda model: model.update(format="cellctl model 2"),
    "no format": lambda model: model.pop("format"),
}


@pytest.mark.parametrize("edit", EDITS.values(), ids=EDITS.keys())
def test_a_model_that_no_fit_wrote_is_refused_by_fit_and_predict(cellctl, files, identified, capsys, edit):
    model = json.loads(identified)
    edit(model)
    (files / "model.json").write_text(json.dumps(model))
    assert cellctl("predict", "model.json", "positions.csv", "-o", "tcp.csv") == 2
    assert cellctl("fit", "robot.yaml", "positions.csv", "--prior", "model.json", "--out", "new.json") == 2
    assert capsys.readouterr().err.count("model.json: ") >= 2
    assert not (files / "tcp.csv").exists()
    assert not (files / "new.json").exists()


@pytest.mark.parametrize("text", ["[" * 100_000, "[]", "7", "\0", '{"format": "cellctl table 1"}'])
def test_what_is_no_model_at_all_is_refused(cellctl, files, capsys, text):
    (files / "model.json").write_text(text)
    assert cellctl("predict", "model.json", "positions.csv") == 2
    assert "model.json: is no model file: " in capsys.readouterr().err


def test_a_newer_model_says_who_can_read_it(cellctl, files, identified, capsys):
    (files / "model.json").write_text(identified.replace("cellctl model 1", "cellctl model 2"))
    assert cellctl("predict", "model.json", "positions.csv") == 2
    assert "of format 'cellctl model 2', and this cellctl reads 'cellctl model 1'" in capsys.readouterr().err


def test_half_a_model_file_is_refused(cellctl, files, identified, capsys):
    (files / "model.json").write_text(identified[: len(identified) // 2])
    assert cellctl("fit", "robot.yaml", "positions.csv", "--prior", "model.json") == 2
    assert "model.json: is no model file" in capsys.readouterr().err


@pytest.mark.parametrize("target", ["folder", "missing/file"])
@pytest.mark.parametrize("option", ["--out", "--json", "--report"])
def test_where_a_result_cannot_go_is_reported_by_its_name_and_nothing_else_is_written(
    cellctl, files, capsys, option, target
):
    (files / "folder").mkdir()
    others = {"--out": "m.json", "--json": "r.json", "--report": "p.html"}
    words = [word for pair in (others | {option: target}).items() for word in pair]
    before = sorted(path.name for path in files.iterdir())
    assert cellctl("fit", "robot.yaml", "positions.csv", *GEOMETRY, *words) == 2
    assert f"{target}: " in capsys.readouterr().err
    assert sorted(path.name for path in files.iterdir()) == before


@pytest.mark.parametrize("target", ["positions.csv", "robot.yaml", "./positions.csv"])
def test_what_is_read_is_not_written_over(cellctl, files, target):
    before = (files / target).read_bytes()
    assert cellctl("fit", "robot.yaml", "positions.csv", *GEOMETRY, "--out", target) == 2
    assert (files / target).read_bytes() == before


def test_two_results_do_not_go_to_one_file(cellctl, files):
    assert cellctl("fit", "robot.yaml", "positions.csv", *GEOMETRY, "--out", "x", "--json", "x") == 2
    assert not (files / "x").exists()


@pytest.mark.long
def test_a_full_disk_ends_with_2_and_leaves_no_half_file(files):
    """The limit on a file's size stands in for the disk: writing the model fails in its middle."""

    def full():
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (2000, 2000))

    program = "from cellctl.cli.main import main; main()"
    words = ["fit", "robot.yaml", "positions.csv", *GEOMETRY, "--out", "model.json"]
    before = sorted(path.name for path in files.iterdir())
    ended = subprocess.run(
        [sys.executable, "-B", "-c", program, *words],
        cwd=files,
        preexec_fn=full,
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )
    assert ended.returncode == 2
    assert "Traceback" not in ended.stderr
    assert "model.json" in ended.stderr
    assert sorted(path.name for path in files.iterdir()) == before


def test_an_interrupted_fit_ends_with_130_and_writes_nothing(cellctl, files, monkeypatch):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("cellctl.operations.fitting.fit", interrupted)
    before = sorted(path.name for path in files.iterdir())
    assert cellctl("fit", "robot.yaml", "positions.csv", "--out", "m.json", "--json", "r.json") == 130
    assert sorted(path.name for path in files.iterdir()) == before


@pytest.mark.parametrize("line", ["1,nan,3", "1,inf,3", "1,1e300,3", "1,,3", "1,2", "1,2,3,4"])
def test_predict_refuses_a_file_with_a_row_that_it_cannot_use(cellctl, files, identified, capsys, line):
    del identified
    (files / "joints.csv").write_text(f"A1,A2,A3\n1,20,-60\n{line}\n")
    assert cellctl("predict", "model.json", "joints.csv", "-o", "tcp.csv") == 2
    assert "joints.csv:3" in capsys.readouterr().err
    assert not Path("tcp.csv").exists()


def test_predict_refuses_radians_in_columns_of_degrees(cellctl, files, identified, capsys):
    del identified
    (files / "joints.csv").write_text("A1,A2,A3\n0.1,0.7,-1.2\n-0.4,0.9,-1.4\n")
    assert cellctl("predict", "model.json", "joints.csv", "-o", "tcp.csv") == 2
    assert "joints.csv:1: A1…A3 are radians" in capsys.readouterr().err


@pytest.mark.parametrize("line", ["nan,34,396,0,30,90", "1e300,34,396,0,30,90", "99999,34,396,0,30,90", "1,2"])
def test_compensate_refuses_a_target_that_is_none(cellctl, files, identified, capsys, line):
    del identified
    (files / "targets.csv").write_text(f"X,Y,Z,A,B,C\n{line}\n")
    assert cellctl("compensate", "model.json", "targets.csv", "--serial", "K1", "-o", "table.json") == 2
    assert "targets.csv:2" in capsys.readouterr().err
    assert not (files / "table.json").exists()


def test_convert_does_not_write_over_what_it_reads(cellctl, files, identified):
    assert cellctl("convert", "model.json", "--to", "poe", "-o", "model.json") == 2
    assert (files / "model.json").read_text() == identified
