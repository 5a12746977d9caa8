"""The journal's file: one SQLite database with one append-only table."""

from __future__ import annotations

from typing import Final

FILE_NAME: Final = "journal.sqlite"
"""In every run folder."""

LOCK_NAME: Final = "journal.lock"
"""Beside it: the writer locks it (flock) and writes its process id, the time and its command line into it."""

APPLICATION_ID: Final = 0x43454C4C
"""`CELL`: marks an SQLite file as a cellctl journal."""

VERSION: Final = 1
"""Counts changes that an older program would misread; new event kinds and new fields do not count."""

CREATE: Final = f"""
CREATE TABLE events (
  seq INTEGER PRIMARY KEY,
  time_ns INTEGER NOT NULL,
  kind TEXT NOT NULL,
  step TEXT NOT NULL,
  attempt INTEGER NOT NULL,
  data TEXT NOT NULL CHECK (json_valid(data))
) STRICT;
CREATE TRIGGER events_are_not_changed BEFORE UPDATE ON events BEGIN SELECT RAISE(ABORT, 'the journal only grows'); END;
CREATE TRIGGER events_are_not_removed BEFORE DELETE ON events BEGIN SELECT RAISE(ABORT, 'the journal only grows'); END;
PRAGMA application_id = {APPLICATION_ID};
PRAGMA user_version = {VERSION};
"""

INSERT: Final = "INSERT INTO events (time_ns, kind, step, attempt, data) VALUES (?, ?, ?, ?, ?)"

SELECT: Final = "SELECT seq, time_ns, kind, step, attempt, data FROM events WHERE seq > ? ORDER BY seq"
