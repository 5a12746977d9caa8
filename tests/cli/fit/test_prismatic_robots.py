"""`cellctl fit` and its companions with a robot on a rail, on a lift, and with a quill, as a person calls them."""

import csv
import json

import numpy as np
import pytest

from cellctl.cli import exit_codes
from cellctl.cli.verbs import app
from cellctl.formats import ModelFile, RobotFile
from tests.helpers.sliding_robots import FLOOR_MM, SCALE, SlidingRobot, write_case


@pytest.fixture
def cellctl(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return lambda *words: exit_codes.exit_code_of(lambda: app([str(word) for word in words], standalone_mode=False))


def fitted(cellctl, tmp_path, *words):
    assert cellctl("fit", *words, "--column", "set", "--json", "fit.json", "--out", "model.json") == 0
    return json.loads((tmp_path / "fit.json").read_text()), ModelFile.load(tmp_path / "model.json")


def value(model, name):
    (found,) = (each for each in model.parameters if each.name == name)
    return found


def test_a_robot_on_a_lift_is_fitted_from_its_urdf_and_a_csv_in_one_command(cellctl, tmp_path):
    write_case(tmp_path, "lift", fit=90, test=40, si=True)
    assert cellctl("convert", "lift.yaml", "--to", "urdf", "-o", "lift.urdf") == 0
    words = ("lift.urdf", "lift_0.csv", "--repeatability", "0.03", "--model", "geometry+scale+straightness")
    report, model = fitted(cellctl, tmp_path, *words)
    assert report["nominal"]["mean"] > 0.6 > 0.12 > report["test"]["mean"]
    assert model.robot.prismatic == (1,)
    assert value(model, "scale1").value == pytest.approx(SCALE, abs=4.0 * value(model, "scale1").sigma)


def test_what_a_urdf_does_not_state_is_asked_for(cellctl, tmp_path, capsys):
    write_case(tmp_path, "lift", fit=20, test=5, si=True)
    cellctl("convert", "lift.yaml", "--to", "urdf", "-o", "lift.urdf")
    assert cellctl("fit", "lift.urdf", "lift_0.csv") == 2
    assert "give it: --repeatability MM" in capsys.readouterr().err
    assert cellctl("fit", "lift.yaml", "lift_0.csv", "--repeatability", "0.03") == 2
    assert "--repeatability: is for a robot given as URDF" in capsys.readouterr().err


@pytest.mark.long
@pytest.mark.parametrize(("kind", "mm", "model_mm"), [("rail", 0.7, 1.25), ("lift", 0.6, 1.2), ("quill", 0.7, 1.2)])
def test_auto_brings_every_kind_to_its_noise(cellctl, tmp_path, kind, mm, model_mm):
    robot, data = write_case(tmp_path, kind)
    report, model = fitted(cellctl, tmp_path, robot, data)
    assert report["nominal"]["mean"] > mm
    assert report["test"]["mean"] < model_mm * FLOOR_MM
    assert ("straightness" in report["model"]) == (kind != "quill")
    number = model.robot.prismatic[0]
    scale = value(model, f"scale{number}")
    assert scale.value == pytest.approx(SCALE, abs=4.0 * scale.sigma)


@pytest.mark.long
def test_draw_wires_identify_a_robot_on_a_lift(cellctl, tmp_path):
    robot, _ = write_case(tmp_path, "lift")
    true = SlidingRobot("lift")
    readings, rng = true.rows(300, 100)[0], np.random.default_rng(1)
    anchors = np.array([[3000, -2500, 300], [5500, 800, 200], [4000, 600, 3500], [2500, -500, 1800]])
    names = np.arange(400) % 4
    lengths = np.linalg.norm(true.tcp(readings) - anchors[names], axis=1) + rng.normal(0.0, 0.03, 400)
    lines = ["A1,A2,A3,A4,A5,A6,A7,anchor,distance,sD,set"]
    for number, (row, name, length) in enumerate(zip(readings.tolist(), names, lengths, strict=True)):
        part = "fit" if number < 300 else "test"
        lines.append(f"{','.join(map(str, row))},W{name},{length:.4f},0.035,{part}")
    (tmp_path / "wires.csv").write_text("\n".join(lines) + "\n")
    report, _ = fitted(cellctl, tmp_path, robot, "wires.csv")
    assert "straightness" in report["model"]
    assert report["nominal"]["mean"] > 0.3 > 0.04 > report["test"]["mean"]


def test_a_table_with_the_lifts_own_names_is_imported_and_its_travel_is_checked(cellctl, tmp_path, capsys):
    write_case(tmp_path, "lift", fit=20, test=5, si=True)
    rows = list(csv.reader((tmp_path / "lift_0.csv").open()))
    rows[0][0], rows[3][0] = "torso_lift", "1.9"
    (tmp_path / "log.csv").write_text("".join(",".join(row) + "\n" for row in rows))
    words = ("log.csv", "--robot", "lift.yaml", "--columns", "q1=torso_lift", "-o", "rows.csv")
    assert cellctl("import", *words) == 0
    assert "q1 is 1900 mm, outside 0…800 mm" in capsys.readouterr().err
    found = list(csv.DictReader((tmp_path / "rows.csv").open()))
    assert len(found) == 24
    assert float(found[0]["q1"]) == float(rows[1][0])


@pytest.fixture
def railed(cellctl, tmp_path):
    """A model of the rail robot; its robot file, data set and model are rail.yaml, rail_0.csv, model.json."""
    write_case(tmp_path, "rail", fit=90, test=40)
    fitted(cellctl, tmp_path, "rail.yaml", "rail_0.csv", "--model", "geometry+scale+straightness")
    return ModelFile.load(tmp_path / "model.json")


def test_a_model_predicts_the_tool_along_the_rail(cellctl, railed, tmp_path):
    assert cellctl("predict", "model.json", "rail_0.csv", "--out", "predicted.csv") == 0
    with (tmp_path / "predicted.csv").open() as stream:
        found = np.array([[float(row[name]) for name in "XYZ"] for row in csv.DictReader(stream)])
    readings, _, sets = SlidingRobot("rail").rows(90, 40)
    away = np.linalg.norm(found - SlidingRobot("rail").tcp(readings), axis=1)[np.array(sets) == "test"]
    assert away.mean() < 0.1


@pytest.mark.long
def test_a_rails_report_has_mm_beside_degrees(cellctl, railed, tmp_path):
    words = ("rail.yaml", "rail_0.csv", "--column", "set", "--model", "geometry", "--report", "report.html")
    assert cellctl("fit", *words) in (0, 1)
    page = (tmp_path / "report.html").read_text()
    assert "A1, mm" in page
    assert "A2, °" in page
    assert "A1, °" not in page


def test_other_verbs_take_the_robot_or_refuse_it_by_name(cellctl, railed, tmp_path, capsys):
    (tmp_path / "targets.csv").write_text("X,Y,Z,A,B,C\n1000,200,900,0,90,0\n")
    refused = [
        ("compensate", "model.json", "targets.csv", "--out", "table.csv"),
        (
            "plan",
            "rail.yaml",
            "--box",
            "800:1200,-300:300,500:900",
            "--angles",
            "0,90,0",
            "--floor",
            "0",
            "--n",
            "10",
            "-o",
            "poses.csv",
        ),
        ("analyse", "rail.yaml", "rail_0.csv"),
        ("convert", "model.json", "--to", "kuka"),
    ]
    for words in refused:
        assert cellctl(*words) == 2, words
        assert "joint 1 of KR 5 on a rail is prismatic" in capsys.readouterr().err, words
    assert cellctl("convert", "model.json", "--to", "dh-csv", "-o", "rail_dh.csv") == 0


def test_planned_poses_use_the_travel_and_their_spans_are_in_mm(cellctl, tmp_path, capsys):
    robot, _ = write_case(tmp_path, "rail", fit=5, test=1)
    words = ("--box", "2000:3500,-300:300,500:900", "--angles", "0:10,80:90,0:10", "--n", "10", "-o", "poses.csv")
    assert cellctl("plan", robot, *words) == 0
    with (tmp_path / "poses.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    readings = np.array([[float(row[f"A{number}"]) for number in range(1, 8)] for row in rows])
    chain, joints = RobotFile.load(robot).chain(), RobotFile.load(robot).joint_map()
    wanted = np.array([[float(row[f"nominal_{axis}"]) for axis in "XYZ"] for row in rows])
    np.testing.assert_allclose(chain.forward(joints.model(readings))[:, :3, 3], wanted, atol=1e-2)
    assert np.ptp(readings[:, 0]) > 100.0
    assert f"A1 {readings[:, 0].min():.1f}…{readings[:, 0].max():.1f} mm" in capsys.readouterr().out


@pytest.mark.long
def test_metres_in_a_column_of_mm_are_found_by_the_setup_check(cellctl, tmp_path, capsys):
    write_case(tmp_path, "rail", fit=60, test=20)
    rows = list(csv.reader((tmp_path / "rail_0.csv").open()))
    rows[1:] = [[repr(float(row[0]) / 1000.0), *row[1:]] for row in rows[1:]]
    (tmp_path / "metres.csv").write_text("".join(",".join(row) + "\n" for row in rows))
    assert cellctl("fit", "rail.yaml", "metres.csv", "--column", "set") == 2
    words = capsys.readouterr().err
    assert "A1 is metres" in words
    assert "write A1, a prismatic joint, in mm" in words


@pytest.mark.long
def test_radians_and_metres_in_columns_of_degrees_and_mm_are_found_by_the_setup_check(cellctl, tmp_path, capsys):
    write_case(tmp_path, "rail", fit=60, test=20, si=True)
    text = (tmp_path / "rail_0.csv").read_text()
    (tmp_path / "named.csv").write_text(text.replace("q1,q2,q3,q4,q5,q6,q7", "A1,A2,A3,A4,A5,A6,A7"))
    assert cellctl("fit", "rail.yaml", "named.csv", "--column", "set") == 2
    assert "joint readings are radians and m in columns of degrees and mm" in capsys.readouterr().err


@pytest.mark.long
def test_a_reversed_rail_is_found_by_the_setup_check(cellctl, tmp_path, capsys):
    write_case(tmp_path, "rail", fit=60, test=20)
    text = (tmp_path / "rail.yaml").read_text()
    (tmp_path / "rail.yaml").write_text(text.replace("type: prismatic, min: 0,", "type: prismatic, sign: -1, min: 0,"))
    assert cellctl("fit", "rail.yaml", "rail_0.csv", "--column", "set") == 2
    assert "A1 reversed" in capsys.readouterr().err
