"""What a run says at its end, afterwards and when it is resumed: what is known of the robot and of the table."""

from __future__ import annotations

import os
from contextlib import nullcontext
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from cellctl.cli import exit_codes
from cellctl.cli.exit_codes import Exit
from cellctl.cli.run_progress import exit_of, show_end
from cellctl.cli.verbs import app
from cellctl.devices import DeviceLost, DeviceUncertain, DeviceUnreachable
from cellctl.engine import Aborted, AbortedByInterlock, Outcome, State
from cellctl.files import InputError, Problem
from cellctl.journal import (
    Journal,
    JournalError,
    KnownEvent,
    Recorded,
    RunEnded,
    RunStarted,
    SourceFile,
    StateChanged,
    StepEnded,
    StepStarted,
)
from cellctl.journal import Outcome as StepOutcome
from cellctl.operations.launch import result_of, resumed_run

TABLE = {
    "id": "6f86d0" * 10 + "6f86",
    "rows": 30,
    "pushed": True,
    "verified": True,
    "active": True,
    "max_correction_deg": 0.1,
}
SHORT = TABLE["id"][:12]
TAKE_BACK = "cellctl table rollback --cell cell.yaml"
PUSH: list[KnownEvent] = [
    StepStarted("push", 1, moves=True),
    Recorded("table", TABLE, "push", 1),
    StepEnded("push", 1, StepOutcome.DONE, {"active": True}),
]
WITHDRAWN: list[KnownEvent] = [
    StepStarted("cleanup.withdraw", 1, moves=True),
    Recorded("table", {**TABLE, "active": False}, "cleanup.withdraw", 1),
    StepEnded("cleanup.withdraw", 1, StepOutcome.DONE),
]
ABORTED: list[KnownEvent] = [RunEnded("aborted", "", "aborted by the operator")]
PROVED: list[KnownEvent] = [
    StepStarted("judge", 1, moves=True),
    Recorded("verdict", {"verdict": "better", "sentence": "Better.", "standoff": {}, "table": TABLE}, "judge", 1),
    StepEnded("judge", 1, StepOutcome.DONE, {}),
    RunEnded("finished", "better"),
]


def run_with(folder: Path, *events: KnownEvent) -> Path:
    """A run folder whose journal holds a begin and these events."""
    run = folder / "runs" / "made"
    file = SourceFile("cell.yaml", "name: x", "0")
    with Journal.create(run, lambda: 0) as journal:
        journal.append(RunStarted(file, file, {}, 1, "lockstep", "me", "2026-11-21T00:00:00Z", "0", {}))
        journal.append(StateChanged("connecting", "running"))
        for event in events:
            journal.append(event)
    return run


def said_at_the_end(
    run: Path, capsys: pytest.CaptureFixture[str], error: Exception | None, *, moved: bool, held: bool
) -> str:
    uncertain = isinstance(error, DeviceUncertain)
    outcome = Outcome(State.UNCERTAIN if uncertain else State.FAILED, error, (), None, 1.0, moved, held)
    show_end(outcome, result_of(run, outcome, 1.0), run, quiet=False)
    return capsys.readouterr().err


def test_a_failed_connection_says_that_nothing_was_moved_and_not_that_the_robot_is_held(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    error = DeviceUnreachable("robot", "no EthernetKRL connection to 127.0.0.1:54600 (no answer)")
    said = said_at_the_end(run_with(tmp_path), capsys, error, moved=False, held=False)
    assert "nothing was moved" in said
    assert "held" not in said


def test_a_robot_that_confirmed_its_standstill_is_reported_as_held(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run, error = run_with(tmp_path), DeviceLost("probe", "no sign of life")
    moved = said_at_the_end(run, capsys, error, moved=True, held=True)
    assert "the robot is held: its controller confirmed that it stands still" in moved
    assert "nothing was moved" not in moved
    assert "nothing was moved, and the robot is held" in said_at_the_end(run, capsys, error, moved=False, held=True)


def test_a_robot_whose_standstill_nobody_confirmed_is_not_said_to_be_held(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    said = said_at_the_end(run_with(tmp_path), capsys, DeviceUncertain("robot", "lost"), moved=True, held=False)
    assert "it is not confirmed that the robot stands still: look at it" in said
    assert "held" not in said


@pytest.mark.parametrize(
    ("state", "error", "code"),
    [
        (State.ABORTED, Aborted("aborted by the operator"), Exit.ABORTED),
        (State.ABORTED, AbortedByInterlock("aborted: interlock 'door' does not hold"), Exit.DEVICE_FAILED),
        (State.FAILED, DeviceLost("robot", "gone"), Exit.DEVICE_FAILED),
        (State.FAILED, InputError(Problem("cell.yaml", 1, 1, "is wrong")), Exit.BAD_INPUT),
        (State.UNCERTAIN, InputError(Problem("cell.yaml", 1, 1, "is wrong")), Exit.UNCERTAIN),
        (State.UNCERTAIN, Aborted("aborted by the operator"), Exit.UNCERTAIN),
    ],
)
def test_the_exit_code_says_who_or_what_ended_the_run(state: State, error: Exception, code: Exit) -> None:
    assert exit_of(Outcome(state, error, (), None, 1.0, True, True)) == code


@pytest.mark.parametrize("moves", [True, False])
def test_nothing_was_moved_is_reported_where_something_could_have_been(
    moves: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    def call() -> None:
        with exit_codes.adding(exit_codes.NOTHING_MOVED) if moves else nullcontext():
            raise DeviceUnreachable("simulator", "was not ready within 60 s")

    assert exit_codes.exit_code_of(call) == 3
    assert ("nothing was moved" in capsys.readouterr().err) == moves


def test_of_many_errors_the_first_are_shown_and_the_others_counted(capsys: pytest.CaptureFixture[str]) -> None:
    def call() -> None:
        raise InputError(Problem("data.csv", line, 0, f"'{chr(96 + line)}' is no number") for line in range(1, 101))

    assert exit_codes.exit_code_of(call) == 2
    said = capsys.readouterr().err.splitlines()
    assert said[0] == "cellctl: 100 errors"
    assert said[-2:] == ["data.csv:20: 't' is no number", "… and 80 more"]


@pytest.mark.parametrize(
    ("events", "words", "cure"),
    [
        (PUSH, f"table {SHORT} was pushed by this run, is not proved, and may be in force", True),
        ([*PUSH, *WITHDRAWN, *ABORTED], f"table {SHORT} was rolled back", False),
    ],
    ids=["not taken back", "taken back"],
)
def test_the_end_of_a_run_says_what_became_of_its_table(
    events: list[KnownEvent], words: str, cure: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    said = said_at_the_end(run_with(tmp_path, *events), capsys, DeviceLost("robot", "gone"), moved=True, held=True)
    assert words in said
    assert (TAKE_BACK in said) == cure


def test_the_command_that_takes_a_table_back_names_a_simulated_cells_memory(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = run_with(tmp_path, *PUSH)
    (run / "simulated_cell.json").write_text("{}")
    said = said_at_the_end(run, capsys, DeviceLost("robot", "gone"), moved=True, held=True)
    assert f"{TAKE_BACK} --state {run / 'simulated_cell.json'}" in said


@pytest.mark.parametrize(
    ("events", "active", "state"),
    [
        (PUSH, True, "not proved, may be in force"),
        (
            [StepStarted("push", 1, moves=True), Recorded("push", {**TABLE, "active": None}, "push", 1)],
            None,
            "not proved, may be in force",
        ),
        ([*PUSH, *WITHDRAWN, *ABORTED], False, "taken back"),
        ([*PUSH, *PROVED], True, "proved"),
    ],
    ids=["killed after the push", "killed in the push", "aborted", "proved"],
)
def test_json_list_and_show_say_whether_the_table_is_in_force(
    events: list[KnownEvent], active: bool | None, state: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = run_with(tmp_path, *events)
    outcome = Outcome(State.ABORTED, None, (), None, 1.0, True, True)
    assert result_of(run, outcome, 1.0).to_json()["table"] == {**TABLE, "active": active, "state": state}
    assert state in cellctl_says(["runs", "--runs", str(run.parent)], capsys)
    assert f"  table      table {SHORT} " in cellctl_says(["show", str(run)], capsys)


def test_resuming_a_run_that_was_killed_after_its_push_names_the_table(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = run_with(tmp_path, *PUSH, StepStarted("rounds[0].standoffs[0].standoff", 1, moves=True))
    campaign = of_the_same_files(monkeypatch)
    with pytest.raises(DeviceUncertain) as refused:
        resumed_run(campaign, run.parent, Path("made"), [], acknowledged=False)
    assert f"table {SHORT} was pushed by this run, is not proved" in str(refused.value)
    assert TAKE_BACK in str(refused.value)
    assert resumed_run(campaign, run.parent, Path("made"), [], acknowledged=True).folder == run


def test_a_run_that_a_process_still_writes_is_not_resumed_and_the_process_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = run_with(tmp_path, StepStarted("points[3].touch", 1, moves=True))
    campaign = of_the_same_files(monkeypatch)
    with Journal.reopen(run, lambda: 0):
        for acknowledged in (False, True):
            with pytest.raises(JournalError) as refused:
                resumed_run(campaign, run.parent, Path("made"), [], acknowledged=acknowledged)
            assert f"process {os.getpid()} writes this run, since 2" in str(refused.value)
            assert "pytest" in str(refused.value)
            assert f"kill {os.getpid()}" in str(refused.value)


@dataclass
class SameCampaign:
    parameters: dict[str, Any] = field(default_factory=dict)


def of_the_same_files(monkeypatch: pytest.MonkeyPatch) -> Any:
    """A campaign that is what `run_with` began."""
    monkeypatch.setattr("cellctl.operations.launch._changes", lambda *_: [])
    return SameCampaign()


def cellctl_says(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    assert exit_codes.exit_code_of(partial(app, arguments, standalone_mode=False)) == 0
    return capsys.readouterr().out
