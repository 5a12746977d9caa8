"""`cellctl plan` as a person calls it: the CSV, its way through an instrument into a fit, figures, refusals."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from cellctl.cli import exit_codes
from cellctl.cli.verbs import app
from cellctl.formats import RobotFile

ROBOT = Path(__file__).parents[2] / "procedures/robots/kr5_r1400.yaml"
BOX = ("--box", "850:1250,-300:300,200:600")


@pytest.fixture
def cellctl(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return lambda *words: exit_codes.exit_code_of(lambda: app([str(word) for word in words], standalone_mode=False))


def rows_of(file):
    with Path(file).open(newline="") as source:
        return list(csv.DictReader(source))


def measured(rows, noise=0.02):
    """The rows as an instrument measures them on a robot with a longer upper arm and an elbow zero 0.05° off."""
    robot = RobotFile.load(ROBOT)
    chain = robot.chain().with_parameters({"a2": 0.6, "theta3": np.deg2rad(0.05)})
    readings = np.array([[float(row[f"A{axis}"]) for axis in range(1, 7)] for row in rows])
    place = chain.forward(robot.joint_map().model(readings))[:, :3, 3]
    place = place @ np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]]) + [2000.0, 300.0, -100.0]
    return place + np.random.default_rng(1).normal(0.0, noise, place.shape)


def save(rows, file):
    with Path(file).open("w", newline="") as target:
        writer = csv.DictWriter(target, rows[0].keys())
        writer.writeheader()
        writer.writerows(rows)


def test_targets_with_measured_positions_filled_in_are_a_data_set_that_fits(cellctl, capsys):
    angles = ("--angles", "-60:60,120:180,-40:40")
    assert cellctl("plan", ROBOT, "--n", 40, "--held-out", 20, *BOX, *angles, "-o", "targets.csv") == 0
    rows = rows_of("targets.csv")
    for row, place in zip(rows, measured(rows), strict=True):
        row.update(dict(zip("XYZ", place, strict=True)))
    save(rows, "measured.csv")
    assert cellctl("fit", ROBOT, "measured.csv", "--model", "geometry", "--json", "fit.json") == 0
    result = json.loads(Path("fit.json").read_text())
    assert (result["n_fit"], result["n_test"]) == (40, 20)
    assert result["test"]["mean"] < 0.08 < 0.2 < result["nominal"]["mean"]


def test_targets_that_were_not_measured_are_rejected_by_line_and_never_taken_for_measured(cellctl, capsys):
    assert cellctl("plan", ROBOT, "--n", 30, *BOX, "--angles", "-60:60,120:180,-40:40", "-o", "targets.csv") == 0
    assert cellctl("fit", ROBOT, "targets.csv") == 2
    assert "targets.csv:2: X is missing" in capsys.readouterr().err


def test_nominal_poses_are_those_of_the_joints_by_the_robot_file(cellctl):
    assert cellctl("plan", ROBOT, "--n", 10, *BOX, "--angles", "0,180,0", "-o", "targets.csv") == 0
    robot = RobotFile.load(ROBOT)
    for row in rows_of("targets.csv"):
        pose = robot.chain().forward(robot.joint_map().model([float(row[f"A{axis}"]) for axis in range(1, 7)]))
        assert pose[:3, 3] == pytest.approx([float(row[f"nominal_{axis}"]) for axis in "XYZ"], abs=1e-4)
        assert "set" not in row
        assert (row["X"], row["Y"], row["Z"]) == ("", "", "")


def test_the_figures_say_what_was_drawn_rejected_and_covered(cellctl, capsys):
    words = ("--method", "joint-uniform", "--dense", 300, "--angles", "0,180,0", "--json", "-", "-o", "t.csv")
    assert cellctl("plan", ROBOT, "--n", 60, *BOX, *words) == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures["n"] == 60
    assert figures["drawn"] == figures["usable"] + sum(figures["rejected"].values())
    assert set(figures["joints"]) == {f"A{axis}" for axis in range(1, 7)}
    assert all(0.5 < joint["filled"] <= 1.0 for joint in figures["joints"].values())


@pytest.mark.long
def test_an_optimal_choice_says_what_it_promises_for_the_task_and_the_held_out_targets_judge_it(cellctl, capsys):
    """For a few targets in a corner of the region the choice is another one than for the region, and better there."""
    angles = ("--angles", "-60:60,120:180,-40:40")
    corner = ("--box", "1150:1250,200:300,500:600", "--angles", "0:20,150:160,0:10")
    assert cellctl("plan", ROBOT, "--n", 12, *corner, "-o", "corner.csv") == 0
    task = [{label: row[f"nominal_{label}"] for label in "XYZABC"} for row in rows_of("corner.csv")]
    save(task, "task.csv")
    words = ("--n", 24, "--held-out", 16, "--optimal", "--model", "geometry", "--dense", 600, *BOX, *angles)
    assert cellctl("plan", ROBOT, *words, "-o", "targets.csv", "--json", "all.json") == 0
    assert "predicted 1 σ" in capsys.readouterr().out
    assert cellctl("plan", ROBOT, *words, "--task", "task.csv", "-o", "near.csv", "--json", "near.json") == 0
    everywhere, near = (json.loads(Path(name).read_text())["design"] for name in ("all.json", "near.json"))
    assert everywhere["sigma_mm"] < 0.8 * everywhere["even_sigma_mm"]
    assert near["task"] == 12
    assert near["sigma_mm"] < everywhere["sigma_mm"]
    rows = rows_of("targets.csv")
    assert [row["set"] for row in rows].count("test") == 16
    for row, place in zip(rows, measured(rows), strict=True):
        row.update(dict(zip("XYZ", place, strict=True)))
    save(rows, "measured.csv")
    fit = ("fit", ROBOT, "measured.csv", "--model", "geometry", "--json", "fit.json", "--out", "model.json")
    assert cellctl(*fit) == 0
    assert json.loads(Path("fit.json").read_text())["test"]["mean"] < 0.08
    known = ("--n", 24, "--optimal", "--prior", "model.json", "--dense", 600, *BOX, *angles, "-o", "more.csv")
    assert cellctl("plan", ROBOT, *known, "--json", "more.json") == 0
    assert json.loads(Path("more.json").read_text())["design"]["sigma_mm"] < everywhere["sigma_mm"]


def test_targets_near_a_path_of_a_file(cellctl):
    Path("path.csv").write_text("X,Y,Z\n900,-200,300\n1200,-200,300\n1200,200,300\n")
    words = ("--method", "near-path", "--path", "path.csv", "--angles", "0,180,0", "-o", "t.csv")
    assert cellctl("plan", ROBOT, "--n", 50, *BOX, *words) == 0
    assert max(abs(float(row["nominal_Z"]) - 300.0) for row in rows_of("t.csv")) < 150.0


def test_all_wrong_options_are_reported_at_once_with_their_cure(cellctl, capsys):
    words = ("--method", "grid", "--box", "1:2,3", "--joints", "1:2", "--path", "p.csv", "--reflector", "1,2,3")
    assert cellctl("plan", ROBOT, "--n", 10, *words, "--near", "0,0,0", "--acceptance", 20) == 2
    said = capsys.readouterr().err
    assert "7 errors" in said
    for option in ("--method: 'grid' is not known", "--box: targets are drawn from one region", "--path", "--station"):
        assert option in said


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--box", "850:1250,-300:300", "--angles", "0,180,0"], "--box: '850:1250,-300:300' is not 3 ranges"),
        (["--box", "1250:850,-300:300,1:2", "--angles", "0,180,0"], "the range of X is 1250…850"),
        (["--box", "1:2,3:4,5:x", "--angles", "0,180"], "--angles: '0,180' is not 3 ranges"),
        (["--joints", "0:1,0:1"], "--joints: '0:1,0:1' is not 6 ranges"),
        ([*BOX, "--angles", "0,180,0", "--near", "1,2"], "--near: '1,2' is not 6 numbers"),
        ([*BOX], "--angles: a box alone has no orientation"),
        ([*BOX, "--angles", "0,180,0", "--method", "near-path"], "--path: near-path needs a path"),
        (["--box", "5000:5100,0:1,0:1", "--angles", "0,180,0"], "no pose of the workspace is reached"),
        (["--joints", "170:180,-90,90,0,0,0"], "a joint limit would be passed"),
        ([*BOX, "--angles", "0,180,0", "--station", "1,2,3", "--facing", "0,0,0"], "0,0,0 is no direction"),
        ([*BOX, "--angles", "0,180,0", "--criterion", "D"], "--criterion: is for an optimal choice"),
        ([*BOX, "--angles", "0,180,0", "--optimal", "--criterion", "E"], "--criterion: 'E' is not known"),
        ([*BOX, "--angles", "0,180,0", "--optimal", "--method", "halton"], "halton is no optimal choice"),
    ],
)
def test_a_wrong_region_or_setting_is_refused_in_plain_text(cellctl, capsys, words, said):
    assert cellctl("plan", ROBOT, "--n", 10, *words) == 2
    assert said in capsys.readouterr().err


def test_a_path_that_leaves_the_box_is_refused(cellctl, capsys):
    Path("path.csv").write_text("X,Y,Z\n900,-200,300\n1300,-200,300\n")
    words = (*BOX, "--angles", "0,180,0", "--method", "near-path", "--path", "path.csv")
    assert cellctl("plan", ROBOT, "--n", 10, *words) == 2
    assert "--box: the path leaves the box" in capsys.readouterr().err


def test_a_path_file_that_is_no_path_is_refused(cellctl, capsys):
    words = (*BOX, "--angles", "0,180,0", "--method", "near-path", "--path", "path.csv")
    for text, said in (
        ("X,Y\n1,2\n", "no column Z"),
        ("X,Y,Z\n1,2,3\n1,2,3\n", "no length"),
        ("X,Y,Z\n1,2,a\n", "'a'"),
    ):
        Path("path.csv").write_text(text)
        assert cellctl("plan", ROBOT, "--n", 10, *words) == 2
        assert said in capsys.readouterr().err
