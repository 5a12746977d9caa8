"""Reads what can be read of a damaged journal, and names the rest."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Self, final

from cellctl.journal.codec import decode
from cellctl.journal.errors import JournalError, named_errors
from cellctl.journal.events import Entry
from cellctl.journal.reader import journal_in, opened_journal
from cellctl.journal.schema import SELECT

_ONE = SELECT.replace("seq > ?", "seq = ?")

Row = tuple[int, int, str, str, int, str]
"""seq, time_ns, kind, step, attempt, data (JSON text) of an event as the journal's file has it."""


@final
@dataclass(frozen=True, slots=True)
class ReadableJournal:
    """The readable events of a run, in order: as rows of the file and as events; damage: the others, as text."""

    rows: tuple[Row, ...]
    entries: tuple[Entry, ...]
    damage: tuple[str, ...]

    @classmethod
    def of(cls, run: Path) -> Self:
        """Those of a run (its folder or its journal), also while it is written.

        Raises JournalError if the journal is missing, of another program or of a newer version, or if SQLite cannot
        read any event.
        """
        path = journal_in(run)
        damage: list[str] = []
        with closing(opened_journal(path)) as connection:
            found = _rows(path, connection, damage)
        rows, entries = [], []
        for row in found:
            try:
                event = decode(row[2:])
                json.loads(row[5])
            except (ValueError, TypeError) as error:
                damage.append(f"event {row[0]} is damaged: {error}")
            else:
                rows.append(row)
                entries.append(Entry(row[0], row[1], event))
        return cls(tuple(rows), tuple(entries), tuple(damage))


def _rows(path: Path, connection: sqlite3.Connection, damage: list[str]) -> list[Row]:
    found: list[Row] = []
    try:
        found.extend(connection.execute(SELECT, (0,)))
    except sqlite3.DatabaseError:
        with named_errors(path):
            last = connection.execute("SELECT max(seq) FROM events").fetchone()[0] or 0
        found = list(_one_by_one(connection, last, damage))
        if not found:
            raise JournalError(path, "no event of it can be read", "restore the run folder from a copy") from None
    return found


def _one_by_one(connection: sqlite3.Connection, last: int, damage: list[str]) -> Iterator[Row]:
    lost: list[int] = []
    for seq in range(1, last + 1):
        try:
            row = connection.execute(_ONE, (seq,)).fetchone()
        except sqlite3.DatabaseError:
            row = None
        if row is None:
            lost.append(seq)
        else:
            yield row
    if lost:
        damage.append(f"{len(lost)} of {last} events cannot be read, between event {lost[0]} and event {lost[-1]}")
