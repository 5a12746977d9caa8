"""The tree of a run's steps shows what was done, what is in progress and what comes; event by event as at once."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

from cellctl.engine import Operator
from cellctl.engine.status import RunProgress
from cellctl.engine.step_tree import Node
from cellctl.journal import (
    Entry,
    Outcome,
    RunEnded,
    RunResumed,
    StateChanged,
    StepEnded,
    StepFailure,
    StepStarted,
    Writer,
    read_journal,
)
from tests.helpers.engine import engine_for, known_procedure, started

WRITER = Writer("1", "2026-11-22T10:00:00Z", "cellctl run")
STEPS = """
  - {id: some, do: test.numbers}
  - id: all
    title: Double each
    for_each: ${some.values}
    as: number
    steps:
      - {id: twice, do: test.double, with: {value: "${number}"}, retry: {attempts: 2, on: [NoContact]}}
      - id: inner
        for_each: [7, 8]
        as: other
        steps:
          - {id: again, do: test.double, with: {value: "${other}"}}
  - {id: clear, confirm: "Is the cell clear?"}
  - id: many
    if: ${some.values[2]} > 2
    then:
      - {id: first, do: test.hold}
    else:
      - {id: second, do: test.hold}
"""
CLEANUP = "  - {id: hold, do: test.hold}"


def nodes(node: Node) -> dict[str, Node]:
    """All nodes inside `node` by path."""
    return {each.path: each for child in node.children for each in (child, *nodes(child).values())}


class Followed:
    """A run's tree after the events given so far; `writer` None: no process executes it."""

    def __init__(self, folder: Path) -> None:
        self.engine = engine_for(STEPS, folder, cleanup=CLEANUP)[0]
        self.writer: Writer | None = WRITER
        self.progress = self._fresh()
        self.entries: list[Entry] = []
        self.add(started(self.engine), StateChanged("connecting", "running"))

    def _fresh(self) -> RunProgress:
        known = known_procedure(self.engine)
        return RunProgress(lambda _: known)

    def add(self, *events: Any) -> None:
        for event in events:
            self.entries.append(Entry(len(self.entries) + 1, 1_000_000_000 * len(self.entries), event))
            self.progress.apply(self.entries[-1])

    def did(self, step: str, result: Any = None) -> None:
        self.add(StepStarted(step, 1, False), StepEnded(step, 1, Outcome.DONE, result))

    def tree(self) -> Node:
        found = self.progress.tree(self.writer)
        assert found is not None
        return found

    def states(self) -> dict[str, str]:
        return {path: node.state.value for path, node in nodes(self.tree()).items()}

    def current(self) -> list[str]:
        return [path for path, node in nodes(self.tree()).items() if node.current]


def test_before_its_list_is_known_a_loop_shows_its_steps_and_no_count(tmp_path: Path) -> None:
    found = nodes(Followed(tmp_path).tree())
    assert (found["all"].title, found["all"].done, found["all"].total) == ("Double each", 0, None)
    assert [child.path for child in found["all"].children] == ["all[].twice", "all[].inner"]
    assert found["all[].twice"].title == "twice"
    assert {node.state for node in found.values()} == {"waiting"}


def test_a_loop_counts_its_passes_and_marks_the_step_in_progress_and_all_around_it(tmp_path: Path) -> None:
    run = Followed(tmp_path)
    run.did("some", {"values": [1, 2, 3]})
    run.did("all[0].twice")
    run.did("all[0].inner[0].again")
    run.did("all[0].inner[1].again")
    run.add(StepStarted("all[1].twice", 1, False))
    found = nodes(run.tree())
    assert (found["all"].done, found["all"].total, found["all"].state) == (1, 3, "running")
    assert [child.path for child in found["all"].children] == ["all[0]", "all[1]"]
    assert (found["all[0]"].state, found["all[1]"].state) == ("done", "running")
    assert (found["all[0].inner"].done, found["all[0].inner"].total) == (2, 2)
    assert run.current() == ["all", "all[1]", "all[1].twice"]


def test_a_step_shows_its_failure_and_how_often_it_was_tried_again(tmp_path: Path) -> None:
    run = Followed(tmp_path)
    run.did("some", {"values": [1]})
    failed = StepEnded("all[0].twice", 1, Outcome.FAILED, None, StepFailure("NoContact", "nothing there"))
    run.add(StepStarted("all[0].twice", 1, True), failed)
    twice = nodes(run.tree())["all[0].twice"]
    assert (twice.state, twice.failure, twice.retried) == ("failed", "nothing there", 0)
    assert run.states()["all"] == "failed"
    run.add(StepStarted("all[0].twice", 2, True), StepEnded("all[0].twice", 2, Outcome.DONE))
    twice = nodes(run.tree())["all[0].twice"]
    assert (twice.state, twice.failure, twice.retried) == ("done", "", 1)
    assert run.states()["all"] == "running"


def test_the_branch_not_taken_is_skipped(tmp_path: Path) -> None:
    run = Followed(tmp_path)
    assert run.states()["many.first"] == run.states()["many.second"] == "waiting"
    run.did("many", {"value": True})
    run.did("many.first")
    assert (run.states()["many.first"], run.states()["many.second"], run.states()["many"]) == (
        "done",
        "skipped",
        "done",
    )


def test_without_its_process_a_step_in_progress_is_interrupted_and_a_resumed_run_goes_on_there(tmp_path: Path) -> None:
    run = Followed(tmp_path)
    run.did("some", {"values": [1, 2]})
    run.add(StepStarted("all[0].twice", 1, True))
    assert run.states()["all[0].twice"] == "running"
    run.writer = None
    assert [run.states()[path] for path in ("all", "all[0]", "all[0].twice")] == ["interrupted"] * 3
    assert run.current() == []
    run.writer = WRITER
    run.add(RunResumed("maria", "2026-11-22T11:00:00Z", "", {}), StateChanged("connecting", "running"))
    assert [run.states()[path] for path in ("all", "all[0]", "all[0].twice")] == ["running", "running", "interrupted"]
    assert run.current() == ["all", "all[0]", "all[0].twice"]


def test_between_two_steps_the_next_one_is_marked_and_at_the_end_none(tmp_path: Path) -> None:
    run = Followed(tmp_path)
    run.did("some", {"values": []})
    assert run.states()["all"] == "skipped"
    assert run.current() == ["clear"]
    run.add(StateChanged("running", "cleaning"), StepStarted("cleanup.hold", 1, False))
    assert run.current() == ["cleanup", "cleanup.hold"]
    run.add(StepEnded("cleanup.hold", 1, Outcome.DONE), RunEnded("aborted"))
    assert run.current() == []
    assert (run.states()["cleanup"], run.states()["clear"]) == ("done", "waiting")


def test_a_tree_kept_up_to_date_equals_one_made_from_the_whole_journal_after_every_event(tmp_path: Path) -> None:
    engine, mailbox, journal = engine_for(STEPS, tmp_path, cleanup=CLEANUP)
    mailbox.confirm_all = Operator.here("cli")
    engine._record.apply(journal.append(started(engine)))
    asyncio.run(engine.run())
    entries = list(read_journal(journal.path))
    known = known_procedure(engine)
    kept = RunProgress(lambda _: known)
    for index, entry in enumerate(entries):
        kept.apply(entry)
        for writer in (WRITER, None, WRITER):
            whole = RunProgress(lambda _: known)
            for each in entries[: index + 1]:
                whole.apply(each)
            assert kept.tree(writer) == whole.tree(writer)
    tree = kept.tree(WRITER)
    assert tree is not None
    assert (tree.state, tree.done, tree.total) == ("done", 13, 13)
