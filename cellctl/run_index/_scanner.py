"""Finds what has changed in a folder of runs since it was indexed, at the cost of one listing if nothing has.

A run that ended by itself is settled: its files change only when it is resumed, which the process that resumes it
tells the index. So a look compares the names of all folders, and the files of the runs that are not settled. A thorough
look compares the file of every journal, too.
"""

from __future__ import annotations

import os
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from hashlib import blake2b
from pathlib import Path
from typing import final

from cellctl.clock import calendar_time
from cellctl.journal import writer_of
from cellctl.journal.journal_file import FILE_NAME, LOCK_NAME
from cellctl.run_index._store import RunIndex

_MINUTE = len("2026-11-28T01:30")
"""A thorough look is kept by the minute: a folder that is followed is looked at every second."""


def _stamp(path: str) -> str:
    try:
        found = os.stat(path)  # noqa: PTH116 - 75 000 of them: a Path costs more than the call
    except (OSError, ValueError):
        return ""
    return f"{found.st_ino}:{found.st_size}:{found.st_mtime_ns}"


def fingerprint(folder: str) -> str:
    """Of the files of the run in `folder`: another one after each change. Empty without a journal."""
    journal = _stamp(f"{folder}/{FILE_NAME}")
    if not journal:
        return ""
    beside = [_stamp(f"{folder}/{name}") for name in (f"{FILE_NAME}-wal", LOCK_NAME)]
    return " ".join([journal, *beside])


@final
@dataclass(frozen=True, slots=True)
class Changes:
    """Names of runs that have to be read (again), the one changed last first, and of those whose folder is gone."""

    unread: tuple[str, ...]
    gone: tuple[str, ...]
    names: str
    thorough: bool


@final
class Scanner:
    """Looks at the folder `runs` of `index`, again and again. Use it from one thread at a time."""

    def __init__(self, index: RunIndex, runs: Path) -> None:
        self._index, self._runs = index, str(runs)
        self._changed_ns, self._sure = 0, False
        self._listed: dict[str, None] = {}
        self._names = ""
        self._kept = ("", "")

    def look(self, *, thorough: bool = False, but: Collection[str] = ()) -> Changes:
        """What has changed; `but`: runs to leave out. A folder that is missing or cannot be read has no runs."""
        listed = self._list()
        names = self._names
        unread: dict[str, None] = {}
        gone: list[str] = []
        if thorough or self._index.folders() != (names, len(listed)):
            known = self._index.known()
            gone = [run for run, (_, present) in known.items() if present and run not in listed]
            for name in listed:
                before, present = known.get(name, ("", False))
                journal, _, _ = before.partition(" ")
                if not present or (thorough and journal != _stamp(f"{self._runs}/{name}/{FILE_NAME}")):
                    unread[name] = None
        unread |= dict.fromkeys(self._unsettled(listed))
        wanted = [name for name in unread if name not in but]
        wanted.sort(key=lambda name: _changed_ns(f"{self._runs}/{name}"), reverse=True)
        return Changes(tuple(wanted), tuple(gone), names, thorough)

    def done(self, changes: Changes) -> None:
        """Keep that all that was found is indexed: the next look finds it unchanged."""
        looked = calendar_time() if changes.thorough else ""
        if (kept := (changes.names, looked[:_MINUTE] or self._kept[1])) != self._kept:
            self._index.remember(changes.names, looked)
            self._kept = kept

    def _list(self) -> dict[str, None]:
        """Names of the folders in it; listed again when the folder has changed, and once more at the look after that:
        two changes within one tick of the file system's clock have one time.
        """
        try:
            changed, before = os.stat(self._runs).st_mtime_ns, self._changed_ns  # noqa: PTH116
            if changed != before or not self._sure:
                with os.scandir(self._runs) as found:
                    self._listed = dict.fromkeys(sorted(each.name for each in found if each.is_dir()))
                told = "\0".join(self._listed).encode(errors="surrogateescape")
                self._names = blake2b(told, digest_size=16).hexdigest()
                self._changed_ns, self._sure = changed, changed == before
        except OSError:
            self._listed, self._names, self._changed_ns = {}, "", 0
        return self._listed

    def _unsettled(self, listed: Collection[str]) -> Iterator[str]:
        for run, before, process in self._index.unsettled():
            folder = f"{self._runs}/{run}"
            if run in listed and (fingerprint(folder) != before or (process and writer_of(Path(folder)) is None)):
                yield run


def _changed_ns(folder: str) -> int:
    try:
        return os.stat(f"{folder}/{FILE_NAME}").st_mtime_ns  # noqa: PTH116
    except OSError:
        return 0
