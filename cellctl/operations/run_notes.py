"""Notes of people on a run, beside its journal: `notes.jsonl`, to which lines are only added."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import final

from cellctl.clock import calendar_time
from cellctl.engine import Operator
from cellctl.files import InputError, Problem
from cellctl.files.json_lines import JsonLines

FILE_NAME = "notes.jsonl"
LONGEST = 2000


@final
@dataclass(frozen=True, slots=True)
class Note:
    """What `operator` on `host` noted at `time` (UTC, ISO 8601)."""

    time: str
    operator: str
    host: str
    text: str


def notes_of(run_folder: Path) -> list[Note]:
    """The notes on the run in `run_folder`, the oldest first; a line that was cut off is left out."""
    found = []
    for data in JsonLines(run_folder / FILE_NAME).read():
        with suppress(TypeError):  # of a newer version
            found.append(Note(**data))
    return found


def add_note(run_folder: Path, operator: Operator, text: str) -> Note:
    """Note `text` on the run, durably. Raises InputError for an empty or too long text; OSError."""
    plain = text.strip()
    if not 0 < len(plain) <= LONGEST:
        raise InputError(Problem("note", 0, 0, f"has {len(plain)} letters", f"write 1 to {LONGEST}"))
    note = Note(calendar_time(), operator.name, operator.host, plain)
    JsonLines(run_folder / FILE_NAME).append(asdict(note))
    return note
