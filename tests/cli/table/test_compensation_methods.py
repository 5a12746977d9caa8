"""`cellctl compensate` with other methods, other outputs, and a cell that the model must fit."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from cellctl.compensation import METHODS
from cellctl.formats import DataSet, ModelFile, RobotFile, TableFile
from cellctl.formats.table_making import nominal_chain
from cellctl.formats.targets import read_targets
from cellctl.kinematics import abc_from_rotation
from cellctl.operations.compensating import compensate_targets
from tests.helpers.arms import KR5_ERRORS, KR5_FILE, kr5_model, readings_near_the_middle, targets_csv

CELL = Path(__file__).parents[3] / "procedures" / "cells" / "sphere_cell.yaml"


def rows_of(path):
    with path.open() as file:
        return [{name: float(value) for name, value in row.items()} for row in csv.DictReader(file)]


def columns(rows, *names):
    return np.array([[row[name] for name in names] for row in rows])


def axes(prefix=""):
    return [f"{prefix}A{axis}" for axis in range(1, 7)]


def cell_of(folder, *, robot=("", ""), cell=("", "")):
    """The shipped cell, with `robot` and `cell` replaced in its files: old and new text."""
    text = KR5_FILE.read_text()
    assert robot[0] in text
    (folder / "robot.yaml").write_text(text.replace(*robot))
    text = CELL.read_text().replace("../robots/kr5_r1400.yaml", "robot.yaml")
    assert cell[0] in text
    (folder / "cell.yaml").write_text(text.replace(*cell))
    (folder / "rsi_ethernet.xml").write_text((CELL.parent / "rsi_ethernet.xml").read_text())
    return "cell.yaml"


def test_compensated_targets_as_csv_need_no_serial_and_hold_the_joints_of_the_table(cellctl, folder):
    assert cellctl("compensate", "model.json", "targets.csv", "-o", "joints.csv") == 0
    assert cellctl("compensate", "model.json", "targets.csv", "--serial", "SIM-1", "-o", "table.json") == 0
    rows, table = rows_of(folder / "joints.csv"), TableFile.load(folder / "table.json")
    np.testing.assert_array_equal(columns(rows, *axes()), [row.compensated for row in table.rows])
    np.testing.assert_array_equal(columns(rows, *axes("nominal_")), [row.nominal for row in table.rows])
    np.testing.assert_array_equal(columns(rows, *"XYZABC"), [row.target for row in table.rows])
    assert columns(rows, "predicted_after_mm").max() < 1e-3 < columns(rows, "predicted_before_mm").min()


def test_the_pseudo_targets_of_the_csv_are_where_the_nominal_robot_would_be_at_the_compensated_joints(cellctl, folder):
    assert cellctl("compensate", "model.json", "targets.csv", "-o", "joints.csv") == 0
    rows, model = rows_of(folder / "joints.csv"), ModelFile.load(folder / "model.json")
    poses = nominal_chain(model).forward(model.robot.joint_map().model(columns(rows, *axes())))
    np.testing.assert_allclose(columns(rows, "pseudo_X", "pseudo_Y", "pseudo_Z"), poses[:, :3, 3], atol=1e-8)
    angles = columns(rows, "pseudo_A", "pseudo_B", "pseudo_C")
    np.testing.assert_allclose(angles, abc_from_rotation(poses[:, :3, :3]), atol=1e-8)
    assert np.linalg.norm(columns(rows, "pseudo_X", "pseudo_Y", "pseudo_Z") - columns(rows, *"XYZ"), axis=1).min() > 0.5


def test_the_csv_is_itself_a_file_of_targets_with_their_postures(cellctl, folder):
    assert cellctl("compensate", "model.json", "targets.csv", "-o", "joints.csv") == 0
    assert cellctl("compensate", "model.json", "joints.csv", "-o", "again.csv") == 0
    once, again = rows_of(folder / "joints.csv"), rows_of(folder / "again.csv")
    np.testing.assert_allclose(columns(again, *axes()), columns(once, *axes()), atol=2e-6)


def test_one_pass_leaves_micrometres_and_the_table_says_so(cellctl, folder):
    command = ("compensate", "model.json", "targets.csv", "--serial", "SIM-1", "-o", "table.json", "--passes", "1")
    assert cellctl(*command) == 0
    table = TableFile.load(folder / "table.json")
    assert table.source.method == "pseudo-target, 1 pass"
    after = [row.predicted_after_mm for row in table.rows]
    assert 1e-3 < max(after) < 0.05


def test_cyclic_search_says_that_it_compensates_the_position_only(cellctl, folder, capsys):
    command = ("compensate", "model.json", "targets.csv", "--method", "cyclic-search", "-o", "joints.csv")
    assert cellctl(*command, "--json", "figures.json") == 0
    figures = json.loads((folder / "figures.json").read_text())
    assert figures["position_only"] is True
    assert figures["orientation_after_deg"]["mean"] > 0.03
    assert "Position only: the orientation is off by" in capsys.readouterr().out


def test_all_methods_side_by_side(cellctl, folder, capsys):
    assert cellctl("compensate", "model.json", "targets.csv", "--method", "all") == 0
    said = capsys.readouterr().out
    assert all(method in said for method in METHODS)
    assert "8/8" in said
    assert "cyclic-search: position only" in said
    assert not (folder / "table.json").exists()


def test_the_comparison_as_json_has_accuracy_error_of_each_pass_time_and_counts(cellctl, folder, capsys):
    assert cellctl("compensate", "model.json", "targets.csv", "--method", "all", "--json", "-") == 0
    methods = {each["method"]: each for each in json.loads(capsys.readouterr().out)["methods"]}
    assert list(methods) == list(METHODS)
    for name, each in methods.items():
        assert (each["targets"], each["reached"], each["unreached"]) == (8, 8, [])
        assert each["seconds_per_target"] > 0.0
        assert each["per_pass_mm"][0] == pytest.approx(each["before"]["position_mm"]["mean"])
        if each["repeats"]:
            assert each["iterated"]["position_mm"]["max"] <= 1e-6
            assert each["per_pass_mm"][1] == pytest.approx(each["one_pass"]["position_mm"]["mean"])
            assert each["per_pass_mm"][1] < 0.01 * each["per_pass_mm"][0]
        assert each["position_only"] == (name == "cyclic-search")


def test_the_comparison_counts_and_names_a_target_that_a_method_does_not_reach(cellctl, folder, capsys):
    readings = readings_near_the_middle(4)
    readings[2, 4] = 0.001
    model = kr5_model(errors={**KR5_ERRORS, "alpha3": 0.003, "alpha5": -0.002})
    region = model.joint_region.model_copy(update={"min": [-90.0] * 6, "max": [130.0] * 6})
    model.model_copy(update={"joint_region": region}).save(folder / "model.json")
    (folder / "targets.csv").write_text(targets_csv(readings))
    assert cellctl("compensate", "model.json", "targets.csv", "--method", "all", "--json", "figures.json") == 0
    assert "targets.csv:4: A4 would be corrected by" in capsys.readouterr().err
    methods = {each["method"]: each for each in json.loads((folder / "figures.json").read_text())["methods"]}
    found = methods["newton-raphson"]
    assert (found["targets"], found["reached"]) == (4, 3)
    assert [each["line"] for each in found["unreached"]] == [4]
    assert found["iterated"]["position_mm"]["max"] <= 1e-6
    assert cellctl("compensate", "model.json", "targets.csv", "-o", "joints.csv") == 2
    said = capsys.readouterr().err
    assert "targets.csv:4: A4 would be corrected by" in said
    assert "near a singularity" in said
    assert "targets.csv:3" not in said
    assert not (folder / "joints.csv").exists()


@pytest.mark.parametrize("words", [("-o", "table.json"), ("--passes", "2")])
def test_a_comparison_writes_no_table_and_has_no_number_of_passes(cellctl, folder, capsys, words):
    assert cellctl("compensate", "model.json", "targets.csv", "--method", "all", *words) == 2
    assert "leave it out" in capsys.readouterr().err
    assert not (folder / "table.json").exists()


def test_a_model_of_this_cells_robot_and_tool_makes_a_table(cellctl, folder):
    words = ("compensate", "model.json", "targets.csv", "--serial", "SIM-1", "-o", "table.json", "--cell")
    assert cellctl(*words, str(CELL)) == 0
    assert cellctl(*words, cell_of(folder)) == 0


@pytest.mark.parametrize(
    ("robot", "words", "cure"),
    [
        (("name: KUKA KR5 R1400", "name: KUKA KR6"), "it is for a 'KUKA KR5 R1400'", "give this robot's model"),
        (("410.3]", "412.3]"), "the model is older than the tool", "--free tool"),
        (("d: 620", "d: 640"), "were changed after the model was identified", "identify again"),
    ],
)
def test_a_model_of_another_robot_or_an_older_tool_is_refused_before_anything_is_computed(
    cellctl, folder, capsys, robot, words, cure
):
    cell = cell_of(folder, robot=robot)
    assert cellctl("compensate", "model.json", "targets.csv", "-o", "joints.csv", "--cell", cell) == 2
    said = capsys.readouterr().err
    assert said.startswith("cellctl: 1 error\nmodel.json: ")
    assert words in said
    assert cure in said
    assert not (folder / "joints.csv").exists()


def test_a_correction_over_the_cells_limit_is_refused_by_line_and_joint(cellctl, folder, capsys):
    assert cellctl("compensate", "model.json", "targets.csv", "-o", "free.csv") == 0
    rows = rows_of(folder / "free.csv")
    sizes = np.abs(columns(rows, *axes()) - columns(rows, *axes("nominal_"))).max(axis=1)
    assert (sizes > 0.27).any()
    cell = cell_of(folder, cell=("limits:\n", "limits:\n  table: {correction_deg: 0.27}\n"))
    assert cellctl("compensate", "model.json", "targets.csv", "-o", "joints.csv", "--cell", cell) == 2
    said = capsys.readouterr().err
    named = [f"targets.csv:{line}:" in said for line in range(2, 10)]
    assert named == (sizes > 0.27).tolist()
    assert "the cell allows 0.27°" in said


def test_compensated_joints_outside_the_joint_limits_are_refused_by_line(cellctl, folder, capsys):
    model = kr5_model(errors={"theta3": -0.004})  # A3 is corrected by +0.23°
    robot = model.robot.model_dump()
    readings = readings_near_the_middle(3)
    robot["joints"][2]["max"] = float(readings[1, 2]) + 0.1
    readings[[0, 2], 2] = readings[1, 2] - 5.0
    model.model_copy(update={"robot": RobotFile.model_validate(robot)}).save(folder / "model.json")
    (folder / "targets.csv").write_text(targets_csv(readings))
    assert cellctl("compensate", "model.json", "targets.csv", "-o", "joints.csv") == 2
    said = capsys.readouterr().err
    assert "targets.csv:3: compensated A3" in said
    assert "outside the joint's limits" in said
    assert "targets.csv:2" not in said
    assert "targets.csv:4" not in said


def test_a_large_correction_is_named_where_no_cell_limits_it(cellctl, folder, capsys):
    kr5_model(errors={**KR5_ERRORS, "theta2": 0.05}).save(folder / "model.json")
    assert cellctl("compensate", "model.json", "targets.csv", "-o", "joints.csv") == 0
    assert "targets.csv:2: a joint is corrected by 2." in capsys.readouterr().err


def test_an_error_map_takes_the_place_of_the_model_also_in_the_predicted_errors(folder):
    """An error of 0.5 mm along X everywhere: the nominal robot is sent 0.5 mm to the other side."""
    model = ModelFile.load(folder / "model.json")
    wanted = read_targets(DataSet.load(folder / "targets.csv"), model.robot)
    found = compensate_targets(
        model, wanted, "targets.csv", method="cyclic-search", errors=lambda q: np.tile([0.5, 0.0, 0.0], (len(q), 1))
    )
    places = nominal_chain(model).forward(found.found.compensated_q)[:, :3, 3]
    np.testing.assert_allclose(places, wanted.poses[:, :3, 3] - [0.5, 0.0, 0.0], atol=2e-6)
    np.testing.assert_allclose([row.predicted_before_mm for row in found.rows], 0.5, atol=1e-4)
    assert max(row.predicted_after_mm for row in found.rows) < 1e-4
