"""The only record of a run: an append-only journal, committed event by event, and its folded state."""

from cellctl.journal.errors import JournalError
from cellctl.journal.events import (
    DeviceHealth,
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
from cellctl.journal.pushed_table import PushedTable
from cellctl.journal.readable import ReadableJournal
from cellctl.journal.reader import is_being_written, journal_in, last_number, read_journal, run_place, writer_of
from cellctl.journal.result import RunResult
from cellctl.journal.state import RecordedRow, RunState, StepState, fold
from cellctl.journal.writer import Journal

__all__ = [
    "DeviceHealth",
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
    "ReadableJournal",
    "Recorded",
    "RecordedRow",
    "RunEnded",
    "RunResult",
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
    "last_number",
    "read_journal",
    "run_place",
    "writer_of",
]
