"""`cellctl status` tells from the journal the same time left as `cellctl run` shows."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from cellctl.engine import Engine, Mailbox, Passes, State
from cellctl.engine.status import RunProgress
from cellctl.journal import Journal, RunResumed, RunStarted, SourceFile, StepStarted, Writer, fold, read_journal
from tests.helpers.engine import LOOP, engine_for, known_procedure

NESTED = """
  - id: outer
    for_each: [1, 2]
    as: first
    steps:
      - id: inner
        for_each: [1, 2, 3]
        as: second
        steps:
          - {id: twice, do: test.double, with: {value: "${second}"}}
"""


class Compared:
    """Counts passes as the display of `cellctl run`, and compares the time left with that of the journal.

    `abort_after`: aborts the run when so many passes are done.
    """

    def __init__(self, engine: Engine, journal: Journal, mailbox: Mailbox, abort_after: int = 99) -> None:
        self.found: list[tuple[float | None, float | None]] = []
        self._engine, self._journal, self._mailbox, self._abort_after = engine, journal, mailbox, abort_after
        self._procedure = replace(known_procedure(engine), expected=8)
        self._passes = Passes(8, lambda: engine._record.last_ns * 1e-9)

    def event(self, event: Any) -> None:
        if isinstance(event, StepStarted) and "[" in event.step:
            self._passes.step_begins()
            progress = RunProgress(lambda _: self._procedure)
            for entry in read_journal(self._journal.path):
                progress.apply(entry)
            left_s = progress.status("run", Writer("1", "now", "cellctl run")).left_s
            self.found.append((left_s, self._passes.left_s))  # compared later: no error in a display ends a run
            if self._passes.done == self._abort_after:
                self._mailbox.abort()

    def loop(self, path: str, index: int, count: int) -> None:
        self._passes.loop(path, index, count)


@pytest.mark.parametrize(("steps", "passes"), [(LOOP, 3), (NESTED, 6)])
def test_the_journal_tells_the_time_left_that_the_run_shows_also_when_it_is_resumed(
    steps: str, passes: int, tmp_path: Path
) -> None:
    engine, mailbox, journal = engine_for(steps, tmp_path)
    source = SourceFile("a", "a", "0")
    started = RunStarted(source, source, {}, 1, "realtime", "me", "2026-11-22T10:00:00Z", "0", {})
    engine._record.apply(journal.append(started))
    first = engine._recorder.watcher = Compared(engine, journal, mailbox, abort_after=1)
    assert asyncio.run(engine.run()).state is State.ABORTED
    journal.close()
    record = fold(read_journal(journal.path))
    with Journal.reopen(journal.path.parent, engine._clock.now_ns) as again:
        record.apply(again.append(RunResumed("me", "2026-11-22T11:00:00Z", "", {})))
        resumed = Engine(engine._plan, engine._run, again, Mailbox(), None, record)
        second = resumed._recorder.watcher = Compared(resumed, again, mailbox)
        assert asyncio.run(resumed.run()).state is State.FINISHED
    assert first.found[0] == second.found[0] == (None, None)
    assert any(shown is not None for _, shown in first.found + second.found) is (passes == 6)
    assert len(first.found + second.found) == passes
    for from_journal, shown in first.found[1:] + second.found[1:]:
        assert from_journal == (None if shown is None else pytest.approx(shown))
