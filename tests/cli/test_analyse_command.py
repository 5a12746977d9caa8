"""`cellctl analyse` as a person calls it: numbers, page, bad input, and real measurements of a UR10."""

from __future__ import annotations

import csv
import json
import random
from pathlib import Path

import numpy as np
import pytest

from cellctl.cli import exit_codes
from cellctl.cli.verbs import app
from cellctl.formats import RobotFile
from tests.helpers.reports import Page

ROOT = Path(__file__).parents[2]
ROBOT = ROOT / "procedures/robots/kr5_r1400.yaml"
UR10 = ROOT.parent / "shared" / "data" / "ur10_tracker" / "measurements_grid.csv"
LOW, HIGH = np.array([-40.0, -110, 60, -60, 20, -90]), np.array([40.0, -60, 120, 60, 90, 90])


def campaign(count=60, still=None, seed=1):
    """Readings (count, 6) and positions of a KR5 with a soft third joint and errors of its links, 0.02 mm of noise."""
    rng, robot = np.random.default_rng(seed), RobotFile.load(ROBOT)
    readings = rng.uniform(LOW, HIGH, (count, 6))
    if still is not None:
        readings[:, still] = 10.0
    chain = robot.chain().with_parameters({"a2": 0.5, "theta5": np.deg2rad(0.05), "d4": -0.4})
    q = robot.joint_map().model(readings)
    q[:, 2] += 0.0006 * np.sin(3.0 * q[:, 2])
    place = chain.forward(q)[:, :3, 3] @ np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]]) + [2000.0, 300.0, -100.0]
    return readings, place + rng.normal(0.0, 0.02, place.shape)


def write(readings, places, file="data.csv"):
    lines = [",".join([f"A{axis}" for axis in range(1, 7)] + ["X", "Y", "Z"])]
    lines += [",".join(map(repr, row)) for row in np.column_stack([readings, places]).tolist()]
    Path(file).write_text("\n".join(lines) + "\n")


@pytest.fixture
def cellctl(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return lambda *words: exit_codes.exit_code_of(lambda: app([str(word) for word in words], standalone_mode=False))


def analysed(cellctl, *options, robot=ROBOT, data="data.csv", check=False):
    words = [] if check else ["--no-check"]
    assert cellctl("analyse", robot, data, "--permutations", 199, *words, "--json", "r.json", *options) == 0
    return json.loads(Path("r.json").read_text())


@pytest.mark.long
def test_the_numbers_of_a_campaign_are_on_the_screen_in_the_json_and_on_the_page(cellctl, capsys):
    write(*campaign())
    first = analysed(cellctl, "--report", "one.html")
    assert analysed(cellctl) == first
    assert (first["postures"], first["pairs"], first["outliers"]) == (60, 1770, [])
    assert first["correlation"]["3-D"]["Dq"]["r"] > 0.1
    page = Page(Path("one.html").read_text())
    assert not page.fetched
    assert f"{first['correlation']['3-D']['Dq']['r']:.3f}" in page.text
    assert "Mantel p" in capsys.readouterr().out


@pytest.mark.long
def test_the_page_has_the_same_bytes_each_time(cellctl):
    write(*campaign())
    for name in ("one.html", "two.html"):
        analysed(cellctl, "--report", name, check=True)
    assert Path("one.html").read_bytes() == Path("two.html").read_bytes()


def test_errors_are_measured_less_nominal_in_the_robots_base_frame(cellctl):
    """A robot whose file is right, with A1 turned by 0.03° in half of the rows: their errors are along the turn."""
    from cellctl.formats import DataSet
    from cellctl.formats.similarity_report import robot_errors, rows_with_positions

    robot, rng = RobotFile.load(ROBOT), np.random.default_rng(1)
    readings = rng.uniform(LOW, HIGH, (80, 6))
    turned = readings + [0.03, 0, 0, 0, 0, 0] * (np.arange(80) % 2)[:, None]
    base = np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]])
    place = robot.chain().forward(robot.joint_map().model(turned))[:, :3, 3]
    write(readings, place @ base + [100.0, 0, 0])
    rows = rows_with_positions(robot, DataSet.load(Path("data.csv")))
    found = robot_errors(rows).found
    along = np.cross([0.0, 0.0, 1.0], found.places) * np.deg2rad(-0.03)  # a KR5's A1 turns against its z
    found_difference = found.errors[1::2].mean(axis=0) - found.errors[::2].mean(axis=0)
    wanted = along[1::2].mean(axis=0)
    assert found_difference == pytest.approx(wanted, abs=0.03)
    assert np.linalg.norm(wanted) > 0.3


def test_what_an_identified_model_leaves_is_smaller(cellctl):
    write(*campaign())
    words = ("--model", "geometry", "--no-check", "--holdout", 0.3, "--out", "model.json")
    assert cellctl("fit", ROBOT, "data.csv", *words) == 0
    nominal, left = analysed(cellctl), analysed(cellctl, "--model", "model.json")
    assert left["error"]["mean"] < 0.5 * nominal["error"]["mean"]


def test_a_far_outlier_is_left_out_and_named_by_line(cellctl, capsys):
    readings, places = campaign()
    write(readings, places)
    clean = analysed(cellctl)
    places[20] += [0.0, 35.0, 0.0]
    write(readings, places)
    found = analysed(cellctl)
    assert found["outliers"] == [22]
    assert "Left out as an outlier: line 22." in capsys.readouterr().out
    assert found["correlation"]["3-D"]["Dq"]["r"] == pytest.approx(clean["correlation"]["3-D"]["Dq"]["r"], abs=0.05)


def test_what_geometry_does_not_explain_is_no_outlier(cellctl):
    """The soft joint's errors are many times the noise; a geometric fit calls some of them outliers."""
    from cellctl.formats import DataSet
    from cellctl.formats.similarity_report import robot_errors, rows_with_positions

    readings, places = campaign(40)
    write(
        np.repeat(readings, 2, axis=0), np.repeat(places, 2, axis=0) + np.random.default_rng(2).normal(0, 0.02, (80, 3))
    )
    rows = rows_with_positions(RobotFile.load(ROBOT), DataSet.load(Path("data.csv")))
    assert robot_errors(rows).outliers == ()


def test_repeated_postures_are_averaged_and_said(cellctl, capsys):
    readings, places = campaign(40)
    again = places + np.random.default_rng(2).normal(0.0, 0.02, places.shape)
    write(np.concatenate([readings, readings]), np.concatenate([places, again]))
    found = analysed(cellctl)
    assert (found["postures"], found["repeats"]) == (40, 40)
    assert "40 rows repeat a posture" in capsys.readouterr().out


def test_a_joint_that_never_moves_is_said(cellctl, capsys):
    write(*campaign(still=5))
    found = analysed(cellctl)
    assert found["still_joints"] == ["A6"]
    assert "A6 never moves: it has no semivariogram" in capsys.readouterr().out
    assert set(found["by_joint"]["x"]) == {"A1", "A2", "A3", "A4", "A5"}


def test_ten_points_are_refused(cellctl, capsys):
    write(*campaign(10))
    assert cellctl("analyse", ROBOT, "data.csv", "--no-check") == 2
    assert "10 different postures are too few for 20 bins of pairs" in capsys.readouterr().err


def test_constant_outputs_are_refused(cellctl, capsys):
    readings, places = campaign()
    write(readings, np.tile(places[0], (60, 1)))
    assert cellctl("analyse", ROBOT, "data.csv", "--no-check") == 2
    assert "X, Y, Z are the same place in all 60 rows" in capsys.readouterr().err


def test_nominal_positions_given_as_measured_are_refused(cellctl, capsys):
    robot = RobotFile.load(ROBOT)
    readings, _ = campaign()
    write(readings, robot.chain().forward(robot.joint_map().model(readings))[:, :3, 3])
    assert cellctl("analyse", ROBOT, "data.csv", "--no-check") == 2
    assert "were computed and not measured" in capsys.readouterr().err


def test_a_set_up_error_is_refused_before_the_analysis(cellctl, capsys):
    readings, places = campaign()
    readings[:, 2] = 180.0 - readings[:, 2]
    write(readings, places)
    assert cellctl("analyse", ROBOT, "data.csv") == 2
    said = capsys.readouterr().err
    assert "A3" in said
    assert "--no-check" in said


def test_copies_of_a_row_are_rejected_by_line(cellctl, capsys):
    readings, places = campaign(40)
    write(np.concatenate([readings, readings[:3]]), np.concatenate([places, places[:3]]))
    assert [row["line"] for row in analysed(cellctl)["rejected"]] == [42, 43, 44]


@pytest.mark.skipif(not UR10.exists(), reason=f"the UR10 measurements are not at {UR10}")
def test_errors_of_a_real_ur10_are_more_alike_at_near_joints_than_at_near_positions(cellctl):
    with UR10.open(newline="") as source:
        rows = random.Random(1).sample(list(csv.DictReader(source, delimiter=";")), 300)
    names = [f"{joint}_joint" for joint in ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")]
    names += [f"measurement_{axis}" for axis in "xyz"]
    numbers = np.array([[float(row[name].replace(",", ".")) for name in names] for row in rows])
    write(np.degrees(numbers[:, :6]), numbers[:, 6:])
    found = analysed(cellctl, robot=ROOT / "procedures/robots/ur10.yaml")["correlation"]["3-D"]
    assert found["Dq"]["r"] > 0.4
    assert found["Dq"]["p"] == 0.005
    assert found["Dp"]["r"] < 0.5 * found["Dq"]["r"]
