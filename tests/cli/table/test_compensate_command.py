"""`cellctl compensate` as a person or a script calls it: the table, whose it is, what is refused and where."""

import csv
import json

import numpy as np
import pytest

from cellctl.compensation import METHODS
from cellctl.formats import ModelFile, TableFile
from cellctl.journal import DevicesConnected, Journal
from tests.helpers.arms import kr5_model, readings_near_the_middle, targets_csv


def compensated(cellctl, folder, *options, targets="targets.csv"):
    assert cellctl("compensate", "model.json", targets, "--serial", "SIM-4711", "-o", "table.json", *options) == 0
    return TableFile.load(folder / "table.json")


def test_compensated_joints_take_the_identified_robot_to_the_targets(cellctl, folder):
    table = compensated(cellctl, folder)
    wanted = [[float(row[name]) for name in "XYZ"] for row in csv.DictReader((folder / "targets.csv").open())]
    model = ModelFile.load(folder / "model.json")
    for kind, least, most in (("nominal", 0.5, 20.0), ("compensated", 0.0, 1e-3)):
        tip = model.predict(np.array([getattr(row, kind) for row in table.rows])).poses[:, :3, 3]
        off = np.linalg.norm(tip - wanted, axis=1)
        assert least <= off.min() <= off.max() <= most


def test_nominal_joints_are_the_given_postures_where_these_reach_the_targets(cellctl, folder):
    table = compensated(cellctl, folder)
    np.testing.assert_allclose([row.nominal for row in table.rows], readings_near_the_middle(8), atol=1e-5)


def test_without_postures_one_is_found_where_the_model_saw_the_robot(cellctl, folder):
    table = compensated(cellctl, folder, targets="bare.csv")
    np.testing.assert_allclose([row.nominal for row in table.rows], readings_near_the_middle(8), atol=1e-5)


def test_figures_go_to_json_and_the_table_to_stdout_where_no_file_is_named(cellctl, folder, capsys):
    assert cellctl("compensate", "model.json", "targets.csv", "--serial", "SIM-4711", "--json", "figures.json") == 0
    table = TableFile.model_validate(json.loads(capsys.readouterr().out))
    figures = json.loads((folder / "figures.json").read_text())
    assert (figures["id"], figures["rows"]) == (table.id, 8)
    assert figures["predicted_after_mm"]["max"] < 1e-3 < figures["predicted_before_mm"]["mean"]
    assert 0.0 < figures["sigma_among_rows_mm"] < figures["sigma_mm"]["rms"]


def test_json_to_stdout_is_json_and_nothing_else(cellctl, folder, capsys):
    table = compensated(cellctl, folder, "--json", "-")
    assert json.loads(capsys.readouterr().out)["id"] == table.id


def test_the_controller_is_the_one_of_the_run_beside_the_model(cellctl, folder):
    connected_run(folder, serial="SIM-77")
    assert cellctl("compensate", "model.json", "targets.csv", "-o", "table.json") == 0
    table = TableFile.load(folder / "table.json")
    assert (table.robot.serial, table.simulated, table.source.run) == ("SIM-77", True, folder.name)


def test_a_model_carries_its_controller_away_from_its_run(cellctl, folder):
    kr5_model(robot_serial="925185", run="run-9").save(folder / "model.json")
    assert cellctl("compensate", "model.json", "targets.csv", "-o", "table.json") == 0
    table = TableFile.load(folder / "table.json")
    assert (table.robot.serial, table.simulated, table.source.run) == ("925185", False, "run-9")


def test_what_was_learnt_on_one_controller_is_not_given_out_for_another(cellctl, folder, capsys):
    connected_run(folder, serial="SIM-77")
    assert cellctl("compensate", "model.json", "targets.csv", "--serial", "925185", "-o", "table.json") == 2
    assert "was learnt on controller 'SIM-77'" in capsys.readouterr().err
    assert not (folder / "table.json").exists()


def test_where_nobody_says_whose_model_it_is_a_serial_is_asked_for(cellctl, folder, capsys):
    assert cellctl("compensate", "model.json", "targets.csv", "-o", "table.json") == 2
    assert "--serial" in capsys.readouterr().err


def test_refused_targets_in_metres_are_recognised(cellctl, folder, capsys):
    (folder / "metres.csv").write_text("X,Y,Z,A,B,C\n1.0593,0.1923,0.4,0,0,180\n")
    assert cellctl("compensate", "model.json", "metres.csv", "--serial", "SIM-1", "-o", "table.json") == 2
    assert "if these are metres, multiply by 1000" in " ".join(capsys.readouterr().err.split())


def test_targets_out_of_reach_are_all_named_by_line_and_no_table_is_written(cellctl, folder, capsys):
    for name in ("targets.csv", "bare.csv"):
        lines = (folder / name).read_text().splitlines()
        for line in (3, 6):
            lines[line - 1] = ",".join(["4000", *lines[line - 1].split(",")[1:]])
        (folder / name).write_text("\n".join(lines))
        assert cellctl("compensate", "model.json", name, "--serial", "SIM-1", "-o", "table.json") == 2
        said = capsys.readouterr().err
        assert f"{name}:3: the target is out of the robot's reach" in said
        assert f"{name}:6: the target is out of the robot's reach" in said
        assert not (folder / "table.json").exists()


def test_a_target_where_the_model_never_saw_the_robot_is_refused_by_line(cellctl, folder, capsys):
    readings = readings_near_the_middle(3)
    readings[1, 0] = 75.0
    (folder / "targets.csv").write_text(targets_csv(readings))
    assert cellctl("compensate", "model.json", "targets.csv", "--serial", "SIM-1", "-o", "table.json") == 2
    said = capsys.readouterr().err
    assert "targets.csv:3: nominal A1 75.000°" in said
    assert "targets.csv:2" not in said


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("X,Y,Z\n1,2,3\n", "has no orientation"),
        ("X,Y,A,B,C\n1,2,3,4,5\n", "has no column Z"),
        ("X,Y,Z,A,B,C,QW,QX,QY,QZ\n1,2,3,4,5,6,1,0,0,0\n", "in two ways"),
        ("X,Y,Z,QW,QX,QY,QZ\n1,2,3,1,1,1,1\n", "no unit quaternion"),
        ("X,Y,Z,A,B,C\n1,2,3,4,5,6\n1,2,x,4,5,6\n", "targets.csv:3: Z 'x' is not a number"),
        ("", "is empty"),
    ],
)
def test_a_targets_file_that_cannot_be_used_is_refused(cellctl, folder, capsys, text, words):
    (folder / "targets.csv").write_text(text)
    assert cellctl("compensate", "model.json", "targets.csv", "--serial", "SIM-1", "-o", "table.json") == 2
    assert words in capsys.readouterr().err


def test_an_unknown_method_is_refused_and_the_known_ones_are_named(cellctl, folder, capsys):
    command = ("compensate", "model.json", "targets.csv", "--serial", "SIM-1", "--json", "-")
    assert cellctl(*command, "--method", "newton") == 2
    said = capsys.readouterr().err
    assert "'newton'" in said
    assert all(method in said for method in METHODS)
    assert "stdout" in said


def connected_run(folder, serial):
    with Journal.create(folder, lambda: 0) as journal:
        who = {"device": "robot", "serial": serial, "model": "KR5", "firmware": "", "simulated": True}
        journal.append(DevicesConnected({"robot": who}))


def test_on_refusal_the_json_has_every_refused_row(cellctl, folder, capsys):
    far = [f"{5000 + i},0,500,0,90,0" for i in range(25)]
    (folder / "far.csv").write_text("\n".join(["X,Y,Z,A,B,C", *far]) + "\n")
    capsys.readouterr()
    assert cellctl("compensate", "model.json", "far.csv", "--serial", "SIM-1", "--json", "refused.json") == 2
    refused = json.loads((folder / "refused.json").read_text())["refused"]
    assert [row["line"] for row in refused] == list(range(2, 27))
    assert all("out of the robot's reach" in row["reason"] and row["cure"] for row in refused)
    assert "25 errors\nfar.csv:2: the target is out of the robot's reach" in (said := capsys.readouterr().err)
    assert "so in 25 places, lines 2–26" in said
