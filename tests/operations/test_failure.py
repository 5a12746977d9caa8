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
from cellctl.operations.results import Failure, as_json, from_json

PROBLEMS = (Problem("data.csv", 0, 0, "is empty"), Problem("robot.yaml", 3, 7, "no such joint", "1 to 6"))
KINDS = [each for each in vars(errors).values() if isinstance(each, type) and issubclass(each, DeviceError)]
DEVICES = [
    (kind("robot", "is silent", "look"), 4 if kind.__name__ == "DeviceUncertain" else 3, "robot", "is silent", "look")
    for kind in KINDS
]


@pytest.mark.parametrize(
    ("error", "code", "file", "what", "cure"),
    [
        *DEVICES,
        (JournalError(Path("/runs/7/j"), "is damaged", "restore it"), 2, "/runs/7/j", "is damaged", "restore it"),
        (FileNotFoundError(2, "No such file", "a.csv"), 2, "a.csv", "No such file", ""),
        (OSError(28, "No space left on device"), 2, "this computer", "No space left on device", ""),
        (OSError("the disk is gone"), 2, "this computer", "the disk is gone", ""),
    ],
)
def test_an_error_has_the_exit_code_of_the_command_line_and_one_problem_with_its_place(
    error: Exception, code: int, file: str, what: str, cure: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert Failure.of(error) == Failure(code, (Problem(file, 0, 0, what, cure),))
    assert ended(error) == code
    assert what in capsys.readouterr().err


def ended(error: Exception) -> int:
    """The exit code of a command that ends with `error`."""

    def call() -> None:
        raise error

    return exit_code_of(call)


def test_wrong_input_keeps_every_problem_with_its_place_and_the_note() -> None:
    error = InputError(PROBLEMS, "nothing was written")
    found = Failure.of(error)
    assert found == Failure(2, PROBLEMS, "nothing was written")
    assert str(found) == "data.csv: is empty\nrobot.yaml:3:7: no such joint\n    1 to 6\nnothing was written"
    assert ended(error) == 2


def test_any_other_error_is_an_internal_one_with_its_class_and_how_to_report_it() -> None:
    error = ZeroDivisionError("division by zero")
    [problem] = Failure.of(error).problems
    assert Failure.of(error).code == ended(error) == 3
    assert (problem.file, problem.what) == ("cellctl", "internal error: ZeroDivisionError: division by zero")
    assert "--debug" in problem.cure


def test_a_failure_comes_back_from_json_as_it_was() -> None:
    found = Failure(4, PROBLEMS, "stopped")
    content = json.loads(json.dumps(as_json(found)))
    assert (content["code"], content["note"]) == (4, "stopped")
    assert content["problems"][1] == {
        "file": "robot.yaml", "line": 3, "column": 7, "what": "no such joint", "cure": "1 to 6",
    }  # fmt: skip
    assert from_json(Failure, content) == found
