"""The parts of the run page: a sentence for every state, the tree of a long run, the log's lines, fields' limits."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from cellctl.console.appearance import in_page_words, is_pausing, progress_of, sentence_of
from cellctl.console.live import LiveRun, Snapshot
from cellctl.console.live._run import LogLine, LogLines
from cellctl.console.pages.run_parts import can_retry, rows_of
from cellctl.console.pages.run_parts import text_of as line_text
from cellctl.console.pages.start import limits_of, text_of
from cellctl.engine.step_tree import NodeState
from cellctl.journal import (
    Entry,
    OperatorAction,
    Outcome,
    RunEnded,
    RunStarted,
    Said,
    SourceFile,
    StateChanged,
    StepEnded,
    StepFailure,
    StepStarted,
    last_number,
)
from cellctl.procedure import Parameter, ParameterType
from tests.helpers.engine import WrittenRun, registry

AGAIN = "ontinue it with the button Retry"
HELD = "The robot is held. 0 measurements are recorded."


@pytest.fixture
def run(tmp_path: Path) -> Iterator[WrittenRun]:
    found = WrittenRun(tmp_path / "run-1", points=200)
    yield found
    found.journal.close()


def seen(run: WrittenRun) -> Snapshot:
    live = LiveRun(run.folder, registry)
    while live.snapshot.events < last_number(run.folder):
        live.look()
    return live.snapshot


def test_a_running_run_says_what_it_does_and_how_far_it_is(run: WrittenRun) -> None:
    run.measured(0)
    run.add(StepStarted("points[1].measure", 1, False, "test.double"))
    now = seen(run)
    assert sentence_of(now) == ("working", "Running: Measure.")
    assert progress_of(now)[1].startswith("2 of 201 steps · 0 %")
    assert not can_retry(now)


def test_a_pause_shows_from_the_click_on_and_a_refused_one_does_not(run: WrittenRun) -> None:
    run.add(OperatorAction("pause", "Ada", refused="the run is paused already"))
    assert not is_pausing(seen(run))
    run.add(OperatorAction("pause", "Ada"))
    now = seen(run)
    assert is_pausing(now)
    assert sentence_of(now)[0] == "waiting"
    run.add(StateChanged("running", "paused", "by the operator"))
    now = seen(run)
    assert (is_pausing(now), sentence_of(now)) == (False, ("waiting", "Paused: by the operator"))


@pytest.mark.parametrize(
    ("state", "reason", "expected"),
    [
        ("finished", "", ("good", "Finished.")),
        ("aborted", "sphere S2 is loose", ("warning", f"Aborted: sphere S2 is loose. C{AGAIN}. {HELD}")),
        (
            "failed",
            "cell: devices do not answer:\nrobot: no answer\n    switch it on\nplc: no answer\n    switch it on",
            (
                "bad",
                "Failed: cell: devices do not answer: robot: no answer; plc: no answer. "
                f"Switch it on; c{AGAIN}. {HELD}",
            ),
        ),
        (
            "uncertain",
            "",
            (
                "bad",
                f"Uncertain state, look at the cell: the clean-up did not succeed. C{AGAIN}. {HELD}",
            ),
        ),
    ],
)
def test_an_ended_run_says_how_it_ended_and_can_be_retried_unless_it_is_finished(
    run: WrittenRun, state: str, reason: str, expected: tuple[str, str]
) -> None:
    run.add(StateChanged("cleaning", state), RunEnded(state, "", reason, robot="the robot is held"))
    run.journal.close()
    now = seen(run)
    assert sentence_of(now) == expected
    assert can_retry(now) is (state != "finished")


def test_a_run_whose_process_was_killed_says_so_and_can_be_retried(run: WrittenRun) -> None:
    run.journal.close()
    now = seen(run)
    cause = "Cut off while running: its process ended without an end of the run"
    assert sentence_of(now) == ("bad", f"{cause}. C{AGAIN}. 0 measurements are recorded.")
    assert can_retry(now)


def test_the_tree_of_a_long_run_lists_the_current_pass_and_the_failed_ones_only(run: WrittenRun) -> None:
    with run.unsafe():
        for index in range(150):
            run.measured(index)
    failed = StepFailure("NoContact", "probe: nothing there\n    look")
    step = "points[150].measure"
    run.add(StepStarted(step, 1, False), StepEnded(step, 1, Outcome.FAILED, None, failed), StepStarted(step, 2, False))
    rows = rows_of(seen(run).tree)
    assert [(row.title, row.depth) for row in rows] == [("Plan", 0), ("Measure", 0), ("Pass 151", 1), ("Measure", 2)]
    assert (rows[1].progress, rows[1].state, rows[3].note) == ("150 of 200", NodeState.RUNNING, "retried 1 ×")
    assert [row.current for row in rows] == [False, True, True, True]


def test_a_line_of_the_log_keeps_its_columns_and_names_the_operator() -> None:
    line = line_text(LogLine(7, 12.34, "operator", "abort: loose\nsphere", "Ada"))
    assert line == 9 * " " + "     12.3 s  operator  Ada: abort: loose\n" + 33 * " " + "sphere"


def test_the_log_has_clock_times_in_real_time_and_of_what_states_one_in_lockstep() -> None:
    def clocks(clock: str) -> list[str]:
        source = SourceFile("a", "a", "0")
        started = RunStarted(source, source, {}, 1, clock, "me", "2026-11-22T10:00:00Z", "0", {})
        acted = OperatorAction("pause", "Ada", calendar="2026-11-22T10:00:05Z")
        lines = LogLines()
        events = (started, Said("moved", ""), acted)
        found = [lines.of(Entry(seq, (100 + seq) * 10**9, event)) for seq, event in enumerate(events)]
        return [line.clock[11:19] for line in found if line]

    assert clocks("realtime") == ["10:00:00", "10:00:01", "10:00:02"]
    assert clocks("lockstep") == ["10:00:00", "", "10:00:05"]


def test_a_page_names_pages_and_buttons_in_place_of_commands() -> None:
    assert (
        in_page_words("look with `cellctl table show CELL`; `cellctl krl`")
        == "look with the page Tables; `cellctl krl`"
    )


def test_limits_and_defaults_are_written_as_an_operator_types_them() -> None:
    assert limits_of(Parameter("a", ParameterType.NUMBER, min=0.5, max=10.0)) == "0.5 … 10"
    assert limits_of(Parameter("a", ParameterType.INTEGER, min=3)) == "≥ 3"
    assert [text_of(value) for value in (5.0, 18, True, None, "S1, S2")] == ["5", "18", "true", "", "S1, S2"]
