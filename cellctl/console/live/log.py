"""The log of a run: what an operator reads, from the events of its journal."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal, final

from cellctl.journal import (
    DevicesConnected,
    Entry,
    Event,
    InterlockChanged,
    OperatorAction,
    Outcome,
    RunEnded,
    RunResumed,
    RunStarted,
    Said,
    StateChanged,
    StepEnded,
    read_journal,
)

LogKind = Literal["message", "state", "operator", "interlock", "failure", "device"]


@final
@dataclass(frozen=True, slots=True)
class LogLine:
    """A line of the log. `seq`: of its event; `time_s`: of the cell's time, s; `who`: an operator, else empty."""

    seq: int
    time_s: float
    kind: LogKind
    text: str
    who: str = ""
    step: str = ""

    def fits(self, kind: str, text: str) -> bool:
        """Whether the line is of this kind and has this text in line, step or person; empty: any."""
        return kind in ("", self.kind) and text.casefold() in f"{self.text} {self.who} {self.step}".casefold()


def log_line(entry: Entry) -> LogLine | None:
    """The line for an event; None for events that the log leaves out, such as measured rows."""
    found = _text(entry.event)
    if found is None:
        return None
    kind, text = found
    who = entry.event.operator if isinstance(entry.event, OperatorAction | RunStarted | RunResumed) else ""
    step = entry.event.step if isinstance(entry.event, Said | StepEnded) else ""
    return LogLine(entry.seq, entry.time_ns * 1e-9, kind, text, who, step)


def whole_log(run_folder: Path) -> tuple[LogLine, ...]:
    """All lines of a run; reads its whole journal. Raises JournalError."""
    lines = (log_line(entry) for entry in read_journal(run_folder))
    return tuple(line for line in lines if line is not None)


def _text(event: Event) -> tuple[LogKind, str] | None:
    match event:
        case Said(text=text):
            return "message", text
        case RunStarted():
            return "state", f"started by {event.operator} with seed {event.seed}, clock {event.clock}"
        case RunResumed():
            return "state", f"resumed by {event.operator}" + (", who checked the cell" if event.acknowledged else "")
        case DevicesConnected(identities):
            return "device", f"connected: {', '.join(identities)}"
        case StateChanged(after=after, reason=reason):
            return "state", f"{after}: {reason}" if reason else after
        case RunEnded():
            return "state", ", ".join(filter(None, (f"ended: {event.state}", event.verdict, event.reason)))
        case OperatorAction():
            return "operator", _action(event)
        case InterlockChanged(interlock=name, holds=holds, text=text):
            return "interlock", f"{name} {'holds again' if holds else 'does not hold'}: {text}"
        case StepEnded(outcome=outcome, attempt=attempt, failure=failure) if outcome is not Outcome.DONE:
            how = f"attempt {attempt} {outcome.value.replace('_', ' ')}"
            return "failure", f"{event.step}: {how}" + (f": {failure.text}" if failure and failure.text else "")
        case _:
            return None


def _action(event: OperatorAction) -> str:
    text = event.action + (f": {event.text}" if event.text else "")
    return f"{text}, refused: {event.refused}" if event.refused else text
