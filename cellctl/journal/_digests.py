"""Digests of a journal's events: they show that an event was changed, or removed, after it was written.

Each event carries the SHA-256 of its own fields and of the digest before it, so the last one stands for the whole
journal. This detects accidents and edits. Whoever writes all later digests again deceives it: compare the last digest
with one that was printed or indexed before.
"""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from hashlib import sha256
from itertools import groupby
from pathlib import Path
from typing import Final, final

from cellctl.journal._reader import Row, journal_in, opened_journal
from cellctl.journal.journal_file import named_errors

ADD_COLUMN: Final = "ALTER TABLE events ADD COLUMN digest TEXT"
"""For a journal that was begun before events had digests."""

_SELECT: Final = "SELECT seq, time_ns, kind, step, attempt, data, digest FROM events ORDER BY seq"


def digest_of(row: Row, before: str) -> str:
    """The digest (SHA-256, hex) of an event, with the digest of the event before it; empty for the first."""
    return sha256(json.dumps([before, *row], ensure_ascii=False, separators=(",", ":")).encode()).hexdigest()


@final
@dataclass(frozen=True, slots=True)
class JournalCheck:
    """A journal compared with its digests.

    events: how many it has; without: those that no digest protects (written by an older cellctl); digest: of the last
    event, empty without one; changed: what is not as it was written, as text.
    """

    events: int
    without: int
    digest: str
    changed: tuple[str, ...]


def check_journal(run: Path) -> JournalCheck:
    """Compare the journal of a run (its folder or its journal) with its digests.

    Raises JournalError if the journal is missing, damaged, of another program or of a newer version.
    """
    path = journal_in(run)
    with closing(opened_journal(path)) as connection, named_errors(path):
        if not has_digests(connection):
            count = connection.execute("SELECT count(*) FROM events").fetchone()[0]
            return JournalCheck(count, count, "", ())
        rows = connection.execute(_SELECT).fetchall()
    found: list[tuple[int, str]] = []
    last, chain, pending = 0, "", []
    for *fields, digest in rows:
        row: Row = tuple(fields)
        found += [(seq, "is missing") for seq in range(last + 1, row[0])]
        last, chain = row[0], digest_of(row, chain)
        if digest is None:
            pending.append(row[0])
        else:
            if digest != chain:
                found += [(seq, "is not as it was written") for seq in (*pending, row[0])]
            chain, pending = digest, []  # go on from the recorded one: a change is reported where it is, once
    unprotected = len(pending)
    return JournalCheck(len(rows), unprotected, rows[-1][-1] or "" if rows else "", tuple(_said(found)))


def has_digests(connection: sqlite3.Connection) -> bool:
    """Whether the journal's table has a column for them."""
    return any(column[1] == "digest" for column in connection.execute("PRAGMA table_info(events)"))


def last_event(connection: sqlite3.Connection) -> tuple[int, str]:
    """Number and digest of the last event; of one without a recorded digest it is computed. (0, ""): no event."""
    last, chain = 0, ""
    for *fields, digest in connection.execute(_SELECT):
        row: Row = tuple(fields)
        last, chain = row[0], digest or digest_of(row, chain)
    return last, chain


def _said(found: list[tuple[int, str]]) -> Iterator[str]:
    """One line for each run of neighbouring events with the same fault."""
    for (_, what), group in groupby(enumerate(found), lambda each: (each[1][0] - each[0], each[1][1])):
        numbers = [seq for _, (seq, _) in group]
        if len(numbers) == 1:
            yield f"event {numbers[0]} {what}"
        else:
            yield f"events {numbers[0]} to {numbers[-1]} {what.replace('is ', 'are ').replace('it was', 'they were')}"
