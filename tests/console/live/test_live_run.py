"""A run is followed by its journal: what a page shows of it, event by event, whatever happens to the journal."""

from __future__ import annotations

import os
import shutil
import signal
import sqlite3
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from cellctl.console.live import LiveRun, Snapshot, whole_log
from cellctl.console.live import _run as tail
from cellctl.engine.status import status_of
from cellctl.engine.step_tree import Node
from cellctl.journal import InterlockChanged, Outcome, RunResumed, StepEnded, StepFailure, StepStarted, read_journal
from tests.helpers.engine import WrittenRun, registry
from tests.helpers.runs import child

PATIENCE = 200


def followed(folder: Path) -> LiveRun:
    return LiveRun(folder, registry)


def shown(live: LiveRun) -> Snapshot:
    """The snapshot once the journal is read to its end."""
    for _ in range(PATIENCE):
        live.look()
    return live.snapshot


def test_a_commit_that_can_be_read_some_time_after_its_last_write_is_shown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = WrittenRun(tmp_path / "run")
    live = followed(run.folder)
    shown(live)
    written = tail.stamps(run.folder)
    monkeypatch.setattr(tail, "stamps", lambda _: written)
    for looks in (0, 1, 5, 30, 100):
        for _ in range(looks):
            live.look()
        run.say(f"on the disk after {looks} looks")
        assert shown(live).status.message == f"on the disk after {looks} looks"


def loop_of(snapshot: Snapshot) -> Node:
    assert snapshot.tree is not None
    return snapshot.tree.children[1]


def test_a_run_is_shown_with_state_progress_and_current_step_after_each_event(tmp_path: Path) -> None:
    run = WrittenRun(tmp_path / "run")
    live = followed(run.folder)
    run.measured(0)
    run.add(StepStarted("points[1].measure", 1, True, "test.double"))
    now = shown(live)
    assert (now.status.state, now.status.step, now.status.phase) == ("running", "points[1].measure", "Measure")
    assert (loop_of(now).done, loop_of(now).total) == (1, 3)
    assert [child.current for child in loop_of(now).children] == [False, True]
    assert now.active
    version = now.version
    run.paused_by("maria")
    assert shown(live).version > version
    assert (live.snapshot.status.state, live.snapshot.status.held_by) == ("paused", "by the operator")
    assert live.snapshot.status == status_of(run.folder, registry())[0]


def test_an_unchanged_run_keeps_its_snapshot(tmp_path: Path) -> None:
    run = WrittenRun(tmp_path / "run")
    live = followed(run.folder)
    now = shown(live)
    assert not live.look()
    assert live.snapshot is now


def test_one_who_followed_from_the_start_sees_the_same_as_one_who_comes_late(tmp_path: Path) -> None:
    run = WrittenRun(tmp_path / "run")
    early = followed(run.folder)
    for action in (
        lambda: run.measured(0),
        lambda: run.paused_by("ben"),
        lambda: run.add(StepStarted("points[1].measure", 1, True)),
        lambda: run.judged("Better than nominal."),
        run.end,
        run.reopen,
        lambda: run.add(RunResumed("maria", "2026-11-22T11:00:00Z", "", {})),
        lambda: run.add(StepStarted("points[1].measure", 2, True)),
    ):
        action()
        late = followed(run.folder)
        assert replace(shown(early), version=0) == replace(shown(late), version=0)


def test_the_log_has_lines_states_actions_with_the_operator_interlocks_and_failures(tmp_path: Path) -> None:
    run = WrittenRun(tmp_path / "run")
    run.say("plan: 3 points")
    run.paused_by("maria")
    run.add(InterlockChanged("door", "gate", "closed", False, "the door is open"))
    run.add(StepStarted("points[0].measure", 1, True))
    run.add(StepEnded("points[0].measure", 1, Outcome.FAILED, None, StepFailure("NoContact", "nothing there")))
    lines = shown(followed(run.folder)).log
    assert [(line.kind, line.who, line.text) for line in lines] == [
        ("state", "maria", "started by maria with seed 1, clock realtime"),
        ("state", "", "running"),
        ("message", "", "plan: 3 points"),
        ("operator", "maria", "pause"),
        ("state", "", "paused: by the operator"),
        ("interlock", "", "door does not hold: the door is open"),
        ("failure", "", "points[0].measure: attempt 1 failed: nothing there"),
    ]


def test_the_log_keeps_the_latest_lines_and_the_whole_log_is_read_on_request(tmp_path: Path) -> None:
    run = WrittenRun(tmp_path / "run")
    with run.unsafe():
        for number in range(1200):
            run.say(f"line {number}")
    lines = shown(followed(run.folder)).log
    assert (len(lines), lines[-1].text) == (1000, "line 1199")
    assert [line.text for line in whole_log(run.folder)][:3] == [
        "started by maria with seed 1, clock realtime",
        "running",
        "line 0",
    ]


def test_the_verdict_is_one_sentence_and_not_that_of_a_failed_attempt(tmp_path: Path) -> None:
    run = WrittenRun(tmp_path / "run")
    live = followed(run.folder)
    assert shown(live).sentence == ""
    run.judged("Better than nominal: 0.31 mm.")
    assert (shown(live).verdict, live.snapshot.sentence) == ("better", "Better than nominal: 0.31 mm.")


def test_a_run_that_begins_while_it_is_followed_is_shown_from_its_first_event(tmp_path: Path) -> None:
    live = followed(tmp_path / "run")
    before = shown(live)
    assert before.status.state == "unreadable"
    assert before.problem is not None
    assert (before.problem.what, "check the path" in before.problem.cure) == ("there is no journal", True)
    WrittenRun(tmp_path / "run")
    now = shown(live)
    assert (now.status.state, now.problem, now.active) == ("running", None, True)


def test_an_ended_run_is_no_longer_active_and_is_one_file_although_it_was_followed(tmp_path: Path) -> None:
    run = WrittenRun(tmp_path / "run")
    live = followed(run.folder)
    shown(live)
    run.end()
    now = shown(live)
    assert (now.status.state, now.ended, now.writing, now.active) == ("finished", True, False, False)
    assert sorted(path.name for path in run.folder.iterdir()) == ["journal.lock", "journal.sqlite"]


def test_a_run_whose_process_is_killed_is_cut_off_and_goes_on_when_it_is_resumed(tmp_path: Path) -> None:
    code = """
import sys
from pathlib import Path
from tests.helpers.engine import WrittenRun
from cellctl.journal import StepStarted
run = WrittenRun(Path(sys.argv[1]))
run.add(StepStarted("points[0].measure", 1, True))
print("written", flush=True)
sys.stdin.read()
"""
    command = [sys.executable, "-c", code, str(tmp_path / "run")]
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[3])}
    live = followed(tmp_path / "run")
    with child(command, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout
        assert process.stdout.readline() == "written\n"
        running = shown(live)
        process.send_signal(signal.SIGKILL)
        process.wait(30)
        killed = shown(live)
    assert (running.status.state, running.status.process) == ("running", str(process.pid))
    assert (killed.status.state, killed.active, killed.ended) == ("cut off while running", False, False)
    assert loop_of(killed).children[0].state == "interrupted"
    run = WrittenRun.continued(live.folder)
    run.add(RunResumed("ben", "2026-11-22T11:00:00Z", "", {}, acknowledged=True))
    run.add(StepStarted("points[0].measure", 2, True))
    resumed = shown(live)
    assert (resumed.status.state, resumed.active) == ("idle", True)
    assert (loop_of(resumed).children[0].state, loop_of(resumed).children[0].children[0].retried) == ("running", 1)
    assert resumed.log[-1].text == "resumed by ben, who checked the cell"


def test_a_damaged_event_is_named_with_its_cure_and_what_precedes_it_is_shown(tmp_path: Path) -> None:
    run = WrittenRun(tmp_path / "run")
    run.measured(0)
    run.say("so far")
    run.end()
    shutil.copy(run.folder / "journal.sqlite", tmp_path / "copy")
    live = followed(run.folder)
    _changed(run.folder, "UPDATE events SET data = '{}' WHERE kind = 'run_ended'")
    now = shown(live)
    assert now.problem is not None
    assert "is damaged: run_ended" in now.problem.what
    assert "from a copy" in now.problem.cure
    assert (now.status.message, now.status.done) == ("so far", 2)
    (tmp_path / "copy").replace(run.folder / "journal.sqlite")
    repaired = shown(live)
    assert (repaired.problem, repaired.status.state, repaired.status.done) == (None, "finished", 2)
    assert len(repaired.log) == len(whole_log(run.folder))


def _changed(folder: Path, statement: str) -> None:
    with sqlite3.connect(folder / "journal.sqlite") as connection:
        connection.execute("DROP TRIGGER events_are_not_changed")
        connection.execute(statement)
    connection.close()


def _garbage(path: Path) -> None:
    path.write_bytes(b"no journal at all" * 1000)


def _foreign(path: Path) -> None:
    with sqlite3.connect(path) as connection:
        connection.execute("PRAGMA application_id = 7")


def _newer(path: Path) -> None:
    with sqlite3.connect(path) as connection:
        connection.execute("PRAGMA user_version = 99")


@pytest.mark.parametrize(
    ("spoil", "what", "cure"),
    [
        (_garbage, "it is no journal", "name a run folder"),
        (_foreign, "it is no journal", "name a run folder"),
        (_newer, "it was written by a newer cellctl", "read it with the cellctl that wrote it"),
    ],
)
def test_a_file_that_is_no_readable_journal_is_a_problem_with_its_cure(
    spoil: Callable[[Path], None], what: str, cure: str, tmp_path: Path
) -> None:
    run = WrittenRun(tmp_path / "run")
    run.end()
    spoil(run.folder / "journal.sqlite")
    now = shown(followed(run.folder))
    assert now.problem is not None
    assert now.problem.what.startswith(what)
    assert now.problem.cure.startswith(cure)
    assert now.status.state == "unreadable"


def test_a_journal_whose_results_this_version_cannot_show_is_a_problem_and_raises_nothing(tmp_path: Path) -> None:
    run = WrittenRun(tmp_path / "run")
    live = followed(run.folder)
    before = shown(live)
    run.did("plan", {"values": 3})  # no list
    now = shown(live)
    assert now.problem is not None
    assert "cellctl show --events" in now.problem.cure
    assert now.status == before.status


@pytest.mark.long
def test_one_event_of_a_run_with_10000_points_costs_far_less_than_reading_its_journal(tmp_path: Path) -> None:
    run = WrittenRun(tmp_path / "run", points=10_000)
    with run.unsafe():
        for index in range(9_990):
            run.measured(index)
    live = followed(run.folder)
    assert loop_of(shown(live)).done == 9_990
    read_s = _seconds(lambda: list(read_journal(run.folder)))
    each_s = []
    for index in range(9_990, 10_000):
        run.measured(index)
        each_s.append(_seconds(live.look))
        assert loop_of(live.snapshot).done == index + 1
        live.look()
    ratio = statistics.median(each_s) / read_s
    print(f"a look at one point more: {ratio:.1e} of reading the journal")
    assert ratio < 0.02


def _seconds(work: Callable[[], object]) -> float:
    began = time.perf_counter()
    work()
    return time.perf_counter() - began
