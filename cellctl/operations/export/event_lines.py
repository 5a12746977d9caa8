"""The events of a run as JSON lines."""

from __future__ import annotations

import json

from cellctl.files import canonical_json
from cellctl.journal import ReadableJournal


def event_lines(journal: ReadableJournal) -> str:
    """One JSON object per line: `seq`, `time_ns` (the cell's time), `kind`, `step`, `attempt`, `data`.

    `data` has all fields of the journal, also those that this version of cellctl does not know.
    """
    names = ("seq", "time_ns", "kind", "step", "attempt", "data")
    lines = (dict(zip(names, (*row[:-1], json.loads(row[-1])), strict=True)) for row in journal.rows)
    return "".join(f"{canonical_json(line)}\n" for line in lines)
