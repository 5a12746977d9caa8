"""Journals of runs that tests write event by event, as an engine would, for what follows them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Self

from cellctl.journal import (
    Journal,
    OperatorAction,
    Outcome,
    Recorded,
    RunEnded,
    RunStarted,
    Said,
    SourceFile,
    StateChanged,
    StepEnded,
    StepStarted,
)
from cellctl.procedure import StepRegistry
from tests.helpers.engine import KINDS

PROCEDURE = """
procedure: test
title: Measure each point
steps:
  - {id: plan, do: test.numbers}
  - id: points
    title: Measure
    for_each: ${plan.values}
    as: number
    steps:
      - {id: measure, do: test.double, with: {value: "${number}"}}
"""


def registry() -> StepRegistry:
    """The kinds of steps of these journals."""
    return StepRegistry(KINDS)


class WrittenRun:
    """A run in `folder` of `points` points whose journal the test writes; it is running after its start."""

    def __init__(self, folder: Path, points: int = 3, calendar: str = "2026-11-22T10:00:00Z") -> None:
        self.folder, self.points, self._ns = folder, points, 0
        self.journal = Journal.create(folder, self._now_ns)
        source = SourceFile("test.yaml", PROCEDURE, "0")
        cell = SourceFile("cell.yaml", "name: x", "0")
        self.add(RunStarted(source, cell, {}, 1, "realtime", "maria", calendar, "0", {}, name=folder.name))
        self.add(StateChanged("connecting", "running"))
        self.did("plan", {"values": list(range(points))})

    @classmethod
    def continued(cls, folder: Path) -> Self:
        """The run in `folder`, written by another process before."""
        run = cls.__new__(cls)
        run.folder, run.points, run._ns = folder, 3, 10**10
        run.reopen()
        return run

    def _now_ns(self) -> int:
        self._ns += 100_000_000
        return self._ns

    def add(self, *events: Any) -> None:
        """Append events."""
        for event in events:
            self.journal.append(event)

    def did(self, step: str, result: Any = None) -> None:
        """Append a whole step."""
        self.add(StepStarted(step, 1, False, "test"), StepEnded(step, 1, Outcome.DONE, result))

    def measured(self, index: int) -> None:
        """Append the step of one point, with its row."""
        step = f"points[{index}].measure"
        self.add(StepStarted(step, 1, True, "test.double"))
        self.add(Recorded("doubled", {"value": 2 * index}, step, 1, 1, True))
        self.add(StepEnded(step, 1, Outcome.DONE, {"value": 2 * index}))

    def say(self, text: str) -> None:
        """Append a line for the operator."""
        self.add(Said(text))

    def paused_by(self, operator: str) -> None:
        """Append a pause."""
        self.add(OperatorAction("pause", operator, host="cell-pc", via="cli"))
        self.add(StateChanged("running", "paused", "by the operator"))

    def judged(self, sentence: str) -> None:
        """Append a verdict."""
        self.add(Recorded("verdict", {"verdict": "better", "sentence": sentence}))

    def end(self, state: str = "finished") -> None:
        """Append the end, and end the process that writes."""
        self.add(StateChanged("running", "cleaning"), StateChanged("cleaning", state), RunEnded(state))
        self.journal.close()

    def reopen(self) -> None:
        """Write on as another process would that resumes the run."""
        self.journal = Journal.reopen(self.folder, self._now_ns)

    @contextmanager
    def unsafe(self) -> Iterator[None]:
        """Inside this context the events are written together: thousands of them in a second."""
        self.journal._connection.execute("PRAGMA synchronous = OFF")
        self.journal._connection.execute("BEGIN")
        yield
        self.journal._connection.execute("COMMIT")
