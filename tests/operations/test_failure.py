"""An error as data: the exit code and the words of each class, and the way to another process and back."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from cellctl.cli.exit_codes import exit_code_of
from cellctl.devices import errors
from cellctl.devices.errors import DeviceError
from cellctl.files import InputError, Problem
from cellctl.journal import JournalError
from cellctl.operations.failure import Failure

PROBLEMS = (Problem("data.csv", 0, 0, "is empty"), Problem("robot.yaml", 3, 7, "no such joint", "1 to 6"))
KINDS = [each for each in vars(errors).values() if isinstance(each, type) and issubclass(each, DeviceError)]


def test_wrong_input_keeps_every_problem_with_its_place_and_the_note() -> None:
    found = Failure.of(InputError(PROBLEMS, "nothing was written"))
    assert found == Failure(2, PROBLEMS, "nothing was written")
    assert str(found) == "data.csv: is empty\nrobot.yaml:3:7: no such joint\n    1 to 6\nnothing was written"


@pytest.mark.parametrize("kind", KINDS)
def test_a_device_that_fails_ends_with_3_and_with_4_only_where_a_person_must_check_the_cell(
    kind: type[DeviceError],
) -> None:
    found = Failure.of(kind("robot", "is silent", "look at it"))
    assert found.code == (4 if kind.__name__ == "DeviceUncertain" else 3)
    assert found.problems == (Problem("robot", 0, 0, "is silent", "look at it"),)


def test_an_unreadable_journal_is_wrong_input_at_its_file() -> None:
    found = Failure.of(JournalError(Path("/runs/7/journal.sqlite"), "is damaged", "restore it"))
    assert found == Failure(2, (Problem("/runs/7/journal.sqlite", 0, 0, "is damaged", "restore it"),))


@pytest.mark.parametrize(
    ("error", "problem"),
    [
        (
            FileNotFoundError(2, "No such file or directory", "a.csv"),
            Problem("a.csv", 0, 0, "No such file or directory"),
        ),
        (OSError(28, "No space left on device"), Problem("this computer", 0, 0, "No space left on device")),
        (OSError("the disk is gone"), Problem("this computer", 0, 0, "the disk is gone")),
    ],
)
def test_an_error_of_the_file_system_is_wrong_input_that_names_the_file_if_it_is_known(
    error: OSError, problem: Problem
) -> None:
    assert Failure.of(error) == Failure(2, (problem,))


def test_any_other_error_is_an_internal_one_with_its_class_and_how_to_report_it() -> None:
    found = Failure.of(ZeroDivisionError("division by zero"))
    assert found.code == 3
    [problem] = found.problems
    assert (problem.file, problem.what) == ("cellctl", "internal error: ZeroDivisionError: division by zero")
    assert "--debug" in problem.cure


def test_a_failure_comes_back_from_json_as_it_was() -> None:
    found = Failure(4, PROBLEMS, "stopped")
    text = json.dumps(found.to_json())
    assert (json.loads(text)["code"], json.loads(text)["note"]) == (4, "stopped")
    place = {"file": "robot.yaml", "line": 3, "column": 7, "what": "no such joint", "cure": "1 to 6"}
    assert json.loads(text)["problems"][1] == place
    assert Failure.from_json(json.loads(text)) == found


@pytest.mark.parametrize(
    "error",
    [
        InputError(PROBLEMS),
        *(kind("robot", "is silent", "look at it") for kind in KINDS),
        JournalError(Path("journal.sqlite"), "is damaged", "restore it"),
        OSError(28, "No space left on device"),
        ZeroDivisionError("division by zero"),
    ],
    ids=lambda error: type(error).__name__,
)
def test_the_command_line_ends_with_the_same_code_and_says_what_is_wrong(
    error: Exception, capsys: pytest.CaptureFixture[str]
) -> None:
    def call() -> None:
        raise error

    found = Failure.of(error)
    assert exit_code_of(call) == found.code
    said = capsys.readouterr().err
    assert all(problem.what in said for problem in found.problems)
