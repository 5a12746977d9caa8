"""`python -m sims truth`: joints in, the simulated robot's true tool centre points out."""

import csv

import numpy as np
import pytest
import yaml

from sims.__main__ import main
from sims.cell import read_cell
from sims.conditions import Conditions
from sims.world import World


@pytest.fixture
def cell(request):
    return request.config.rootpath / "procedures/cells/sphere_cell.yaml"


@pytest.fixture
def truth(cell, tmp_path, capsys):
    """Runs the command on a joints file of this text; returns (exit code, rows or None, stderr)."""

    def run(text, *more, at=cell):
        joints, out = tmp_path / "joints.csv", tmp_path / "out.csv"
        joints.write_text(text)
        code = main(["truth", str(at), str(joints), "-o", str(out), *more])
        rows = list(csv.reader(out.open())) if out.exists() else None
        return code, rows, capsys.readouterr().err

    return run


HEADER = "A1,A2,A3,A4,A5,A6\n"


def test_each_row_gets_the_worlds_mean_tool_centre_point(truth, cell):
    code, rows, _ = truth(HEADER + "0,-90,90,0,45,0\n10,-80,100,20,30,-40\n")
    world = World(read_cell(cell), 1)
    assert code == 0
    assert rows[0] == ["X", "Y", "Z"]
    expected = [world.true_tcp([0, -90, 90, 0, 45, 0]), world.true_tcp([10, -80, 100, 20, 30, -40])]
    for row, place in zip(rows[1:], expected, strict=True):
        assert [float(value) for value in row] == pytest.approx(place, abs=1e-6)


def test_columns_are_found_by_name_and_others_ignored(truth):
    plain = truth(HEADER + "1,-90,90,2,45,3\n")
    mixed = truth("note,A6,A5,A4,X,A3,A2,A1\nhello,3,45,2,99,90,-90,1\n")
    assert mixed == plain


def test_another_seed_is_another_robot(truth):
    text = HEADER + "0,-90,90,0,45,0\n"
    assert truth(text, "--seed", "2") != truth(text, "--seed", "3")


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", ":1: columns A1…A6 are expected"),
        ("A1,A2\n0,0\n", ":1: columns A1…A6 are expected, each once; there are A1, A2"),
        ("A1,A1,A2,A3,A4,A5,A6\n", ":1: columns"),
        ("q1,q2,q3,q4,q5,q6\n", ":1: columns"),
        (HEADER + "0,0,0,0,0,0\n0,0,zero,0,0,0\n", ":3: A3 is a number of degrees, not 'zero'"),
        (HEADER + "0,0\n", ":2: A3 is a number of degrees, not ''"),
        (HEADER + "0,0,0,nan,0,0\n", ":2: A4 is a number of degrees, not 'nan'"),
    ],
)
def test_joints_that_cannot_be_read_are_exit_code_2_and_nothing_is_written(truth, text, complaint):
    code, rows, errors = truth(text)
    assert (code, rows) == (2, None)
    assert complaint in errors


ROW = "10,-80,100,20,30,-40"
READINGS = (10, -80, 100, 20, 30, -40)


@pytest.fixture
def flexible(cell, tmp_path):
    """The cell's robot with compliance, play and growing links; its file and its world."""
    content = yaml.safe_load(cell.read_text())
    content["model"] = str(cell.parent / content["model"])
    content["simulate"]["errors"] = {"compliance": 1, "backlash": 1, "expansion": 1}
    path = tmp_path / "flexible.yaml"
    path.write_text(yaml.safe_dump(content))
    return path, World(read_cell(path), 1)


@pytest.mark.parametrize(
    ("columns", "cells", "conditions"),
    [
        ("", "", Conditions()),
        (",D6,D5,D4,D3,D2,D1", ",1,0,-1,1,-1,1", Conditions((1, -1, 1, -1, 0, 1))),
        (",temperature", ",31.5", Conditions(temperature_c=31.5)),
        (",payload", ",4.5", Conditions(payload_kg=4.5)),
        (
            ",payload,payload_x,payload_y,payload_z",
            ",4.5,20,-5,90",
            Conditions(payload_kg=4.5, payload_at=(20.0, -5.0, 90.0)),
        ),
        (",payload,temperature,D1,D2,D3,D4,D5,D6", ",,,,-1,,,,", Conditions((0, -1, 0, 0, 0, 0))),
    ],
)
def test_rows_say_under_which_conditions_the_robot_stands(flexible, truth, columns, cells, conditions):
    path, world = flexible
    code, rows, _ = truth(HEADER.strip() + f"{columns}\n{ROW}{cells}\n", at=path)
    assert code == 0
    assert [float(value) for value in rows[1]] == pytest.approx(world.true_tcp(READINGS, conditions), abs=1e-6)
    if conditions != Conditions():
        assert world.true_tcp(READINGS, conditions) != world.true_tcp(READINGS)


def test_asked_for_the_pose_it_gives_the_tools_angles_too(flexible, truth):
    path, world = flexible
    code, rows, _ = truth(HEADER + ROW + "\n", "--pose", at=path)
    assert (code, rows[0]) == (0, list("XYZABC"))
    assert [float(value) for value in rows[1]] == pytest.approx(world.true_pose(READINGS), abs=1e-6)


def test_asked_for_a_reflector_it_gives_its_true_place(truth, cell, tmp_path):
    content = yaml.safe_load(cell.read_text())
    content["model"] = str(cell.parent / content["model"])
    content["reflectors"] = {
        "on_flange": [
            {"id": "R1", "xyz": [0, 0, 90], "facing": [0, 0, 1]},
            {"id": "R2", "xyz": [80, 0, 90], "facing": [0, 0, 1]},
        ]
    }
    path = tmp_path / "reflectors.yaml"
    path.write_text(yaml.safe_dump(content))
    places = []
    for name in ("R1", "R2"):
        code, rows, _ = truth(HEADER + ROW + "\n", "--reflector", name, at=path)
        assert (code, rows[0]) == (0, list("XYZ"))
        places.append([float(value) for value in rows[1]])
    flange = World(read_cell(path), 1).true_flange(READINGS)
    first, second = (flange[:3, :3].T @ (np.array(place) - flange[:3, 3]) for place in places)
    assert 0.05 < np.linalg.norm(first - [0, 0, 90]) < 3.0  # off by 0.5 mm on each axis, 1 σ
    assert second - first == pytest.approx([80, 0, 0], abs=4.0)
    code, rows, errors = truth(HEADER + ROW + "\n", "--reflector", "R9", at=path)
    assert code == 2
    assert "no reflector 'R9' on the robot; it has R1, R2" in errors


@pytest.mark.parametrize(
    ("columns", "cells", "complaint"),
    [
        ("D1,D2", "1,1", ":1: columns D1…D6 are expected, each once"),
        ("D1,D2,D3,D4,D5,D6", "1,1,1,1,1,2", ":2: D6 is 1, -1 or 0, not '2'"),
        ("temperature", "warm", ":2: temperature is a number of °C, not 'warm'"),
        ("payload,payload_x,payload_y", "5,1,2", ":2: payload_x, payload_y, payload_z are three numbers of mm"),
        ("payload", "-1", ":2: payload is at least 0 kg, not '-1'"),
        ("payload,payload", "1,1", ":1: column payload is there more than once"),
        ("payload", "1e7", ":2: the joints are too soft for what they carry"),
    ],
)
def test_conditions_that_cannot_be_are_refused_with_their_place(flexible, truth, columns, cells, complaint):
    code, rows, errors = truth(f"{HEADER.strip()},{columns}\n{ROW},{cells}\n", at=flexible[0])
    assert (code, rows) == (2, None)
    assert complaint in errors
