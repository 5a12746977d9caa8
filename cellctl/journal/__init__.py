"""The only truth about a run: an append-only journal, committed event by event, and what it folds to."""

from cellctl.journal.errors import JournalError
from cellctl.journal.events import (
    DevicesConnected,
    Entry,
    Event,
    InterlockChanged,
    KnownEvent,
    OperatorAction,
    Outcome,
    RawEvent,
    Recorded,
    RunEnded,
    RunResumed,
    RunStarted,
    Said,
    SourceFile,
    StateChanged,
    StepEnded,
    StepFailure,
    StepStarted,
)
from cellctl.journal.lock import Writer
from cellctl.journal.pushed_table import PUSH_ROWS, PushedTable
from cellctl.journal.reader import is_being_written, journal_in, read_journal, writer_of
from cellctl.journal.state import RecordedRow, RunState, StepState, fold
from cellctl.journal.writer import Journal

__all__ = [
    "PUSH_ROWS",
    "DevicesConnected",
    "Entry",
    "Event",
    "InterlockChanged",
    "Journal",
    "JournalError",
    "KnownEvent",
    "OperatorAction",
    "Outcome",
    "PushedTable",
    "RawEvent",
    "Recorded",
    "RecordedRow",
    "RunEnded",
    "RunResumed",
    "RunStarted",
    "RunState",
    "Said",
    "SourceFile",
    "StateChanged",
    "StepEnded",
    "StepFailure",
    "StepStarted",
    "StepState",
    "Writer",
    "fold",
    "is_being_written",
    "journal_in",
    "read_journal",
    "writer_of",
]
