"""What a data file is understood as, and which robot of the library is suggested for it."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

from cellctl.files import InputError
from cellctl.formats import DataSet
from cellctl.operations.fit_options import Asked
from cellctl.operations.robot_suggestion import suggest_robots
from cellctl.operations.understanding import Understood, read_data, understand
from cellctl.pendant_import import Choices

INPUTS = Path(__file__).parents[1] / "golden" / "inputs"
ROBOT = INPUTS / "robot.yaml"


def understood(data: Path, robot: Path | None = None, artefact: Path | None = None) -> Understood:
    """A data file as understood with the default options."""
    asked = Asked(None, "auto", artefact, True, (), "base", None, None)
    return understand(read_data(data, None, Choices(), robot), robot, asked)


def changed(source: Path, target: Path, change: dict[tuple[int, str], str]) -> Path:
    """A copy of a CSV file with other cells, by line and column."""
    with source.open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    for (line, column), value in change.items():
        rows[line - 2][column] = value
    with target.open("w", newline="") as stream:
        writer = csv.DictWriter(stream, rows[0])
        writer.writeheader()
        writer.writerows(rows)
    return target


def test_a_data_set_is_described_in_figures_and_words_before_a_robot_is_chosen() -> None:
    found = understood(INPUTS / "positions.csv")
    words = dict(found.words())
    assert (found.rows, found.kinds, found.joints, found.unit) == (60, {"positions": 60}, 3, "deg")
    assert words["Rows"] == "60 positions"
    assert words["Joints"] == "3, in degrees"
    assert words["Held-out rows"].startswith("by the column set: fit (")
    assert not found.problems


def test_a_robot_that_belongs_to_the_data_passes_the_set_up_check() -> None:
    found = understood(INPUTS / "positions.csv", ROBOT)
    assert dict(found.words())["Set-up check"] == "no set-up error found"
    assert (found.robot, found.usable, list(found.problems)) == ("elbow arm", 60, [])


def test_touches_name_their_spheres() -> None:
    found = understood(INPUTS / "touches.csv", ROBOT, INPUTS / "artefact.yaml")
    assert dict(found.words())["Spheres"] == "2: S1, S2"
    assert found.kinds == {"touches": 60}


def test_rejected_rows_are_listed_with_line_and_reason(tmp_path: Path) -> None:
    data = changed(INPUTS / "positions.csv", tmp_path / "data.csv", {(7, "X"): "abc", (9, "A2"): ""})
    found = understood(data, ROBOT)
    assert [(row["line"], row["reason"]) for row in found.rejected] == [
        (7, "X 'abc' is not a number"),
        (9, "A2 is missing"),
    ]
    assert dict(found.words())["Rows"] == "58 positions; 2 of 60 cannot be used"


def test_a_set_up_error_is_a_problem_at_its_line_of_the_robot_file(tmp_path: Path) -> None:
    wrong = tmp_path / "robot.yaml"
    lines = ROBOT.read_text().splitlines(keepends=True)
    place = next(number for number, line in enumerate(lines) if "min: -180" in line) + 1
    lines[place] = lines[place].replace("{min", "{sign: -1, min")
    wrong.write_text("".join(lines))
    found = understood(INPUTS / "positions.csv", wrong)
    assert [(problem.file, problem.line) for problem in found.problems] == [(str(wrong), place + 1)]
    assert "A2 reversed" in found.problems[0].what


def test_a_robot_with_other_joints_is_a_problem_with_a_cure() -> None:
    found = understood(INPUTS / "positions.csv", INPUTS / "six.yaml")
    assert "A1…A6" in found.problems[0].what
    assert found.problems[0].cure == "missing: A4, A5, A6"


@pytest.mark.parametrize(
    ("name", "content", "line", "what"),
    [
        ("data.csv", bytes(range(256)), 0, "is not text"),
        ("data.csv", b"", 0, "is empty"),
        ("data.csv", b"A1,A2,A3\n1,2,3\n", 1, "has no column X, Y, Z, and no table of positions is given"),
        ("data.csv", b"12.0,13.0,14.0\n1,2,3\n", 1, "has no headings, and rows of 3 numbers"),
        ("part.src", b"DEF part()\nEND\n", 0, "holds no row with three numbers"),
    ],
    ids=["binary", "empty", "no positions", "no header", "program without points"],
)
def test_a_file_that_is_no_data_set_is_refused_with_place_and_cure(
    tmp_path: Path, name: str, content: bytes, line: int, what: str
) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError) as caught:
        understood(tmp_path / name)
    problem = caught.value.problems[0]
    assert (problem.file, problem.line) == (str(tmp_path / name), line)
    assert what in problem.what


def test_a_robot_program_with_a_table_of_positions_becomes_a_data_set(tmp_path: Path) -> None:
    program, table = tmp_path / "points.dat", tmp_path / "points.csv"
    postures = [(10 * row, -90 + row, 90 - row, row, 20 + row, 3 * row) for row in range(4)]
    program.write_text(
        "".join(
            f"DECL E6AXIS XP{row}={{A1 {a},A2 {b},A3 {c},A4 {d},A5 {e},A6 {f}}}\n"
            for row, (a, b, c, d, e, f) in enumerate(postures, 1)
        )
    )
    table.write_text("name;X;Y;Z\n" + "".join(f"P{row};{600 * row};{row};{2 * row}\n" for row in range(1, 5)))
    given = read_data(program, table, Choices())
    found = understand(given, None, Asked(None, "auto", None, True, (), "base", None, None))
    assert found.kinds == {"positions": 4}
    assert any("paired by name" in each for each in found.decided)


def test_the_library_robot_that_was_measured_is_suggested() -> None:
    found = suggest_robots(DataSet.load(INPUTS / "poses.csv"))
    assert (found.robots[0].name, found.certainty) == ("kr5_r1400", "clear")
    assert found.sentence.startswith("This is a KUKA KR5 R1400")


def test_no_robot_is_suggested_for_rows_of_another_arm() -> None:
    found = suggest_robots(DataSet.load(INPUTS / "positions.csv"))
    assert found.certainty == "none"
    assert "give your own robot file" in found.sentence
