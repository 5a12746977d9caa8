"""What is reported of set-up errors: where each is, the evidence, the cure; of right set-ups, nothing."""

import csv
import time
from pathlib import Path

import pytest

from cellctl.files import InputError, load_yaml
from cellctl.formats import DataSet, RobotFile, load_artefact, measurements
from cellctl.operations.setup_refusals import SetupFiles, refuse_setup_errors

GOLDEN = Path(__file__).parents[2] / "golden" / "inputs"


def problems(files, robot="robot.yaml", data="positions.csv", artefact=None):
    """The problems that these files are refused with; none where they are not."""
    robot, data = files / robot, files / data
    spheres = load_artefact(files / artefact) if artefact else None
    document = load_yaml(robot)
    measured = measurements(RobotFile.from_document(document), DataSet.load(data), artefact=spheres)
    try:
        refuse_setup_errors(measured, SetupFiles(document, data, files / artefact if artefact else None), "")
    except InputError as error:
        return error.problems
    return []


def rewritten(files, change):
    """`positions.csv` with each row (a dict of texts) as `change` makes it."""
    with (files / "positions.csv").open(newline="") as source:
        rows = list(csv.DictReader(source))
    rows = change(rows)
    with (files / "positions.csv").open("w", newline="") as target:
        writer = csv.DictWriter(target, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)


def test_a_sound_set_up_is_let_through(files):
    assert problems(files) == []
    assert problems(files, data="touches.csv", artefact="artefact.yaml") == []


@pytest.mark.long
def test_a_reversed_joint_is_reported_at_its_line_in_the_robot_file(files):
    text = (files / "robot.yaml").read_text()
    joint = "  - {min: -180, max: 180, max_speed: 100}\n"
    turned = text.replace(joint * 3, joint + joint.replace("{min", "{sign: -1, min") + joint)
    (files / "robot.yaml").write_text(turned)
    (problem,) = problems(files)
    line = 1 + turned.splitlines().index(joint.replace("{min", "{sign: -1, min").rstrip())
    assert (problem.file, problem.line) == (str(files / "robot.yaml"), line)
    assert problem.column == 1 + turned.splitlines()[line - 1].index("-1,")
    assert problem.what.startswith("A2 reversed: RMS ")
    assert problem.what.endswith(" mm")
    assert problem.cure == f"sign: 1 for joint 2 in {files / 'robot.yaml'}"


def test_a_refusal_names_the_way_round_it_and_what_that_means(cellctl, files, capsys):
    rewritten(files, lambda rows: [row | {"A3": str(-float(row["A3"]))} for row in rows])
    assert cellctl("fit", files / "robot.yaml", files / "positions.csv") == 2
    assert "--no-check skips this check and fits anyway" in capsys.readouterr().err.splitlines()[-1]


@pytest.mark.long
def test_rows_in_another_order_than_their_joints_are_refused_in_time(cellctl, files, capsys):
    """What the JSON says of an impossible set-up is nothing: none is written. 20 s are what a person was promised."""
    measured = list(csv.DictReader((files / "positions.csv").open(newline="")))[::-1]
    rewritten(files, lambda rows: [row | {k: m[k] for k in "XYZ"} for row, m in zip(rows, measured, strict=True)])
    began = time.monotonic()
    assert cellctl("fit", files / "robot.yaml", files / "positions.csv", "--json", files / "r.json") == 2
    assert time.monotonic() - began < 20.0
    said = capsys.readouterr().err
    assert "robot file and data do not belong together: RMS " in said
    assert "--no-check" in said
    assert not (files / "r.json").exists()


def test_a_key_that_is_not_there_yet_is_reported_at_its_joint(files):
    rewritten(files, lambda rows: [row | {"A3": str(-float(row["A3"]))} for row in rows])
    (problem,) = [problem for problem in problems(files) if problem.what.startswith("A3 reversed")]
    lines = (files / "robot.yaml").read_text().splitlines()
    assert problem.line == 1 + [number for number, text in enumerate(lines) if "max_speed" in text][2]
    assert "sign: -1 for joint 3" in problem.cure


@pytest.mark.long
def test_a_length_that_no_such_robot_has_is_refused_with_the_length_that_the_rows_need(files):
    text = (files / "robot.yaml").read_text()
    (files / "robot.yaml").write_text(text.replace("a: 500", "a: 312"))
    (problem,) = problems(files)
    line = 1 + next(number for number, row in enumerate(text.splitlines()) if "a: 500" in row)
    assert (problem.file, problem.line) == (str(files / "robot.yaml"), line)
    assert problem.what.startswith("this is not the robot that was measured: its rows need other lengths, a2 +189 mm (")
    assert problem.cure.startswith("give the file of the robot that was measured (`cellctl robots` lists the library)")


@pytest.mark.long
def test_lengths_known_only_roughly_are_let_through_once_the_file_states_so(files):
    text = (files / "robot.yaml").read_text().replace("a: 500", "a: 475")
    (files / "robot.yaml").write_text(text)
    (problem,) = problems(files)
    assert problem.what.startswith("this is not the robot that was measured: ")
    (files / "robot.yaml").write_text(text + "tolerances: {link_mm: 20}\n")
    assert problems(files) == []


@pytest.mark.long
def test_the_file_of_a_sister_is_refused_with_the_robot_of_the_library_that_was_measured(cellctl, capsys):
    """Rows of a KR5 R1400, written by another program; the elbow of the KR5 arc is 80 mm wider."""
    assert cellctl("fit", "kr5_arc", GOLDEN / "poses.csv", "--model", "geometry") == 2
    told = capsys.readouterr().err
    assert "kr5_arc.yaml:" in told
    assert abs(float(told.partition("its rows need other lengths, a3 ")[2].partition(" mm")[0]) + 80.0) < 1.0
    assert "kr5_r1400 of the library. This is a KUKA KR5 R1400: " in told


def test_units_are_reported_at_the_header_of_the_data_set(files):
    rewritten(files, lambda rows: [row | {axis: str(float(row[axis]) / 1000) for axis in "XYZ"} for row in rows])
    (problem,) = problems(files)
    assert (problem.file, problem.line) == (str(files / "positions.csv"), 1)
    assert problem.what.startswith("X, Y, Z are metres: RMS ")
    assert problem.cure == f"write X, Y, Z in mm in {files / 'positions.csv'}"


def test_rows_out_of_step_are_reported_by_their_line(files):
    def late(rows):
        joints = [{name: row[name] for name in ("A1", "A2", "A3")} for row in rows]
        return rows[:40] + [row | joints[number + 39] for number, row in enumerate(rows[40:])]

    rewritten(files, late)
    (problem,) = problems(files)
    assert problem.line in (42, 43)  # the header is line 1; row 40 still has the joints of row 39 …
    assert f"from line {problem.line} on the measurements belong to the joints of the row after" in problem.what


def test_exchanged_rows_are_both_told(files):
    def exchanged(rows):
        for axis in "XYZ":
            rows[4][axis], rows[20][axis] = rows[20][axis], rows[4][axis]
        return rows

    rewritten(files, exchanged)
    (problem,) = problems(files)
    assert "the measurements of line 6 and line 22 are exchanged: RMS " in problem.what


def test_what_explains_as_much_is_reported_as_the_other_possibility(files):
    """A mirror turns this flat arm's A1 about: nobody can tell which of the two it was."""
    rewritten(files, lambda rows: [row | {"A1": str(-float(row["A1"]))} for row in rows])
    told = problems(files)
    assert len(told) >= 2
    assert all("these rows do not show which" in problem.cure for problem in told)
    assert {Path(problem.file).name for problem in told} == {"robot.yaml", "positions.csv"}


def test_left_handed_positions_are_reported_at_the_data_set(files):
    rewritten(files, lambda rows: [row | {"Y": str(-float(row["Y"]))} for row in rows])
    assert any(problem.what.startswith("the measuring frame is left-handed: RMS ") for problem in problems(files))


def test_rows_in_metres_among_others_are_reported_by_their_lines(files):
    def mixed(rows):
        small = [row | {axis: str(float(row[axis]) / 1000) for axis in "XYZ"} for row in rows[20:40]]
        return [*rows[:20], *small, *rows[40:]]

    rewritten(files, mixed)
    (problem,) = problems(files)
    assert problem.line == 22
    assert problem.what.startswith("in line 22 to line 41 X, Y, Z look like metres (× 1000): RMS ")
    assert problem.cure.startswith("write X, Y, Z in one unit: mm")


def test_a_wrong_certified_distance_is_reported_where_it_stands_with_what_the_rows_say(files):
    text = (files / "artefact.yaml").read_text()
    (files / "artefact.yaml").write_text(text.replace("403.113", "503.113"))
    text = text.replace("centre: [600, 201, 350]", "centre: [600, 301, 350]")  # or the file denies itself
    (files / "artefact.yaml").write_text(text.replace("403.113", "503.113"))
    (problem,) = problems(files, data="touches.csv", artefact="artefact.yaml")
    assert (Path(problem.file).name, problem.line) == ("artefact.yaml", 6)
    told, found = problem.what.removesuffix(" mm are found)").split(" estimated from these rows (errors from ")
    given, estimate = told.split(" given, ")
    assert 0.0 < float(found) < 1.0
    assert given == "spacing S1–S2: 503.113 mm"
    distance, sigma = map(float, estimate.removesuffix(" mm").split(" ± "))
    assert abs(distance - 403.113) < 4.0 * sigma < 4.0


def test_a_distance_said_on_the_command_line_is_refused_like_any_error(cellctl, capsys):
    wrong = ["--artefact", "artefact.yaml", "--no-distances", "--spacing", "S1,S2=405.1±0.01"]
    assert cellctl("fit", "robot.yaml", "touches.csv", *wrong, "--model", "geometry") == 2
    assert "--spacing: spacing S1–S2: 405.1 mm given, 403.1" in capsys.readouterr().err


def test_distances_all_in_inches_are_refused_together_with_the_factor(cellctl, capsys):
    inches = [word for mm in ("15.8706", "15.871", "15.87") for word in ("--spacing", f"S1,S2={mm}±0.01")]
    assert cellctl("fit", "robot.yaml", "touches.csv", "--artefact", "artefact.yaml", "--no-distances", *inches) == 2
    told = capsys.readouterr().err
    assert "--spacing: all 3 spacings that can be checked: × 25.4" in told
    assert "another unit, or an artefact of another size?" in told
