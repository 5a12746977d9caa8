"""`cellctl import` as a technician calls it: what is written, what is said, and what is refused."""

import csv
import json

import numpy as np
import pytest

from cellctl.formats import DataSet

DAT = "DEFDAT  MESSUNG\r\n; Prüfstand\r\n{}ENDDAT\r\n"


@pytest.fixture
def typed(files):
    """The cell's 60 positions as a KRL list of postures and a hand-typed table; the numbers as a data set has them."""
    with (files / "positions.csv").open() as source:
        rows = list(csv.DictReader(source))
    points = "".join(
        f"DECL E6AXIS XP{n}={{A1 {row['A1']},A2 {row['A2']},A3 {row['A3']},E1 0.0}}\r\n"
        for n, row in enumerate(rows, 1)
    )
    (files / "messung.dat").write_bytes(DAT.format(points).encode("latin-1"))
    lines = [f"P{n};" + ";".join(_german(row[axis]) for axis in "XYZ") for n, row in enumerate(rows, 1)]
    table = "\r\n".join(["Punkt;X [m];Y [m];Z [m]", *reversed(lines)])
    (files / "positionen.csv").write_bytes(table.encode("latin-1"))
    return rows


def _german(millimetres):
    return f"{float(millimetres) / 1000:.9f}".replace(".", ",")


@pytest.mark.long
def test_a_pendants_list_and_a_typed_table_give_the_data_set_that_fit_reads(cellctl, files, typed, capsys):
    assert cellctl("import", "messung.dat", "positionen.csv", "--robot", "robot.yaml", "-o", "data.csv") == 0
    said = capsys.readouterr()
    assert said.out == ""
    for words in ("data.csv: 60 rows", "decimal comma", "positions in m, as the headings say", "paired by name"):
        assert words in said.err
    data = DataSet.load(files / "data.csv")
    assert data.columns == ("name", "A1", "A2", "A3", "X", "Y", "Z")
    found = {row[0]: [float(cell) for cell in row[1:]] for row in data.cells}
    for n, row in enumerate(typed, 1):
        wanted = [float(row[name]) for name in ("A1", "A2", "A3", "X", "Y", "Z")]
        np.testing.assert_allclose(found[f"XP{n}"], wanted, rtol=0, atol=1e-6)
    assert cellctl("fit", "robot.yaml", "data.csv", "--json", "result.json") == 0
    assert json.loads((files / "result.json").read_text())["verdict"] == "better"


def test_rows_in_no_pair_are_named_by_line_on_stderr_and_in_the_json(cellctl, files, typed, capsys):
    lines = (files / "positionen.csv").read_text("latin-1").splitlines()
    del lines[4]
    lines[9] = "P51;1,5;x;2"
    (files / "positionen.csv").write_text("\n".join(lines))
    assert cellctl("import", "messung.dat", "positionen.csv", "-o", "data.csv", "--json", "said.json") == 0
    said = json.loads((files / "said.json").read_text())
    assert said["rows"] == 58
    assert [(row["file"], row["line"], row["name"]) for row in said["left_out"]] == [
        ("messung.dat", 53, "XP51"),
        ("messung.dat", 59, "XP57"),
        ("positionen.csv", 10, "P51"),
    ]
    shown = capsys.readouterr().err
    assert all(f"{row['file']}:{row['line']}: {row['name']}: {row['reason']}" in shown for row in said["left_out"])


def test_without_an_output_file_the_data_set_goes_to_stdout_and_the_words_to_stderr(cellctl, typed, capsys):
    assert cellctl("import", "messung.dat", "positionen.csv") == 0
    assert capsys.readouterr().out.splitlines()[0] == "name,A1,A2,A3,X,Y,Z"


def test_joints_and_measurements_in_one_file_need_no_pairing(cellctl, files, capsys):
    text = "id;Goal x;pan;lift;elbow;measurement_x;measurement_y;measurement_z;air\r\n"
    text += "".join(f"{n};0,1;0,{n};-1,57;1,0;{n}00,5;-1,571;{n},25;23,5\r\n" for n in range(1, 10))
    (files / "tracker.csv").write_text(text)
    columns = ["--columns", "q1=pan,q2=lift,q3=elbow", "--columns", "temperature=air"]
    assert cellctl("import", "tracker.csv", "-o", "data.csv", *columns) == 0
    data = DataSet.load(files / "data.csv")
    assert data.columns == ("name", "q1", "q2", "q3", "X", "Y", "Z", "temperature")
    assert data.cells[1] == ("2", "0.2", "-1.57", "1.0", "200.5", "-1.571", "2.25", "23.5")
    assert "joints in radians" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["messung.dat"], "give the table of positions too"),
        (["messung.dat", "none.csv"], "none.csv: cannot be read"),
        (["messung.dat", "positionen.csv", "-o", "positionen.csv"], "is read here"),
        (["messung.dat", "positionen.csv", "--json", "-"], "give -o FILE too"),
        (["messung.dat", "positionen.csv", "--unit", "feet"], "mm or cm or m"),
        (["messung.dat", "positionen.csv", "--unit", "mm"], "headings say m"),
        (["messung.dat", "positionen.csv", "--columns", "X"], "'X' is not column=heading"),
        (["messung.dat", "positionen.csv", "--columns", "X=Ost"], "has no column X ('Ost')"),
    ],
)
def test_wrong_calls_end_with_2_and_the_cure_and_write_nothing(cellctl, files, typed, capsys, words, said):
    before = {path.name: path.read_bytes() for path in files.iterdir()}
    assert cellctl("import", *words) == 2
    assert said in capsys.readouterr().err
    assert {path.name: path.read_bytes() for path in files.iterdir()} == before


def test_the_errors_of_both_files_are_reported_at_once(cellctl, files, typed, capsys):
    (files / "j.csv").write_text("J1;J2;J3\n0,1;0,2;0,3\n")
    (files / "p.csv").write_text("X;Y;Z\n1,234;2,345;3,456\n")
    assert cellctl("import", "j.csv", "p.csv") == 2
    said = capsys.readouterr().err
    assert "2 errors" in said
    assert "j.csv:1: degrees or radians?" in said
    assert "p.csv:2: '1,234' may be 1234 or 1.234" in said


def test_a_joint_out_of_reach_of_the_robot_file_leaves_its_row_out(cellctl, files, typed, capsys):
    text = (files / "messung.dat").read_bytes().replace(b"XP3={A1 ", b"XP3={A1 9")
    (files / "messung.dat").write_bytes(text)
    assert cellctl("import", "messung.dat", "positionen.csv", "--robot", "robot.yaml", "-o", "data.csv") == 0
    said = capsys.readouterr().err
    assert "data.csv: 59 rows" in said
    assert "messung.dat:5: XP3: A1 " in said


@pytest.mark.parametrize(
    ("content", "said"), [(b"", "is empty"), (b"PK\x03\x04....", "is a spreadsheet"), (b"a\0b", "is not text")]
)
def test_files_that_are_no_lists_are_named(cellctl, files, typed, capsys, content, said):
    (files / "p.csv").write_bytes(content)
    assert cellctl("import", "messung.dat", "p.csv") == 2
    assert f"p.csv: {said}" in capsys.readouterr().err


@pytest.mark.parametrize(("column", "words"), [("A1=nonsense", "'nonsense' for A1"), ("X=nowhere", "'nowhere'")])
def test_a_named_column_that_no_file_has_is_refused(cellctl, files, typed, column, words, capsys):
    assert cellctl("import", "messung.dat", "positionen.csv", "--columns", column, "-o", "data.csv") == 2
    assert words in capsys.readouterr().err
    assert not (files / "data.csv").exists()


def test_one_file_of_an_instrument_may_hold_joints_groups_uncertainties_and_times(cellctl, files):
    text = (
        "Collection,Group,Point,A1 [deg],A2 [deg],A3 [deg],X [mm],Y [mm],Z [mm],Ux,Uy,Uz,Date,Time\n"
        "A,Main,P1,1,2,31,1203.45,2.5,3.5,0.01,0.02,0.03,2026-11-21,10:00\n"
    )
    (files / "one.csv").write_text(text)
    assert cellctl("import", "one.csv", "--coverage", "2", "-o", "data.csv") == 0
    data = DataSet.load(files / "data.csv")
    assert dict(zip(data.columns, data.cells[0], strict=True)) == {
        "name": "P1",
        "A1": "1.0",
        "A2": "2.0",
        "A3": "31.0",
        "X": "1203.45",
        "Y": "2.5",
        "Z": "3.5",
        "time": "2026-11-21 10:00",
        "sX": "0.005",
        "sY": "0.01",
        "sZ": "0.015",
    }


MODULE = """MODULE M
  CONST robtarget p10:=[[568,190,300],[0,0.707107,-0.707107,0],[-1,0,-1,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
  CONST jointtarget p20:=[[1,2,3,4,5,6],[9E9,9E9,9E9,9E9,9E9,9E9]];
ENDMODULE
"""


def test_the_cartesian_points_of_a_program_become_a_target_file(cellctl, files, capsys):
    (files / "part.mod").write_text(MODULE)
    assert cellctl("import", "part.mod", "--targets", "-o", "targets.csv") == 0
    assert (files / "targets.csv").read_text().splitlines() == [
        "name,X,Y,Z,QW,QX,QY,QZ",
        "p10,568.0,190.0,300.0,0.0,0.707107,-0.707107,0.0",
    ]
    said = capsys.readouterr().err
    assert "targets.csv: 1 target" in said
    assert "part.mod:3: p20: jointtarget holds joints" in said


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["part.mod", "positionen.csv", "--targets"], "POSITIONS: has no meaning with --targets"),
        (["part.mod", "--targets", "--pair", "name"], "--pair: has no meaning with --targets"),
        (["part.mod", "positionen.csv", "--frame", "wobj0"], "give --targets too"),
        (["part.mod", "positionen.csv", "--coverage", "0"], "is no number of σ"),
        (["part.mod", "positionen.csv", "--j3", "up"], "horizontal or arm"),
    ],
)
def test_options_without_a_meaning_are_refused(cellctl, files, typed, capsys, words, said):
    (files / "part.mod").write_text(MODULE)
    assert cellctl("import", *words) == 2
    assert said in capsys.readouterr().err
