"""`python -m sims truth`: joints in, the simulated robot's true tool centre points out."""

import csv

import pytest

from sims.__main__ import main
from sims.cell import read_cell
from sims.world import World


@pytest.fixture
def cell(request):
    return request.config.rootpath / "procedures/cells/sphere_cell.yaml"


@pytest.fixture
def truth(cell, tmp_path, capsys):
    """Runs the command on a joints file of this text; returns (exit code, rows or None, stderr)."""

    def run(text, *more):
        joints, out = tmp_path / "joints.csv", tmp_path / "out.csv"
        joints.write_text(text)
        code = main(["truth", str(cell), str(joints), "-o", str(out), *more])
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
