"""Writes the changes of the table in force on a controller to its history.

The change itself matters more: if the history cannot be written, the change is made and the reason is kept.
"""

from __future__ import annotations

import getpass
import os
import secrets
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import final

from cellctl.clock import calendar_time
from cellctl.devices import DeviceError, DeviceLost, DeviceRefused, DeviceUncertain, LimitExceeded
from cellctl.files import write_atomically
from cellctl.files.writing import append_line
from cellctl.formats import TableFile
from cellctl.operations.table_changes import Action, Begin, End, Result, Seen, TableFacts
from cellctl.operations.table_history import TableHistory


@final
@dataclass(slots=True)
class Change:
    """A change under way. activated: the controller has confirmed it."""

    activated: bool = False


@final
class TableRecorder:
    """Records the changes that this process makes on one controller.

    run: the campaign that makes them, None: a command. who: the person, or person@host; empty: the user of this
    process. failure: why the history could not be written; empty if it was.
    """

    def __init__(self, history: TableHistory, run: str | None = None, who: str = "") -> None:
        self.history = history
        self._run = run
        self._who = who if "@" in who else user_here(who)
        self.failure = ""

    @contextmanager
    def change(
        self, action: Action, table: TableFile | str | None, replaced: str | None, reason: str = ""
    ) -> Iterator[Change]:
        """Record the begin, and the end by how this context ends; its errors pass through.

        table: to be in force afterwards, a file or the id of one that the controller has; replaced: the id before it.
        """
        table_id, facts = self._kept(table)
        name, change = secrets.token_hex(8), Change()
        begin = Begin(
            change=name,
            time=calendar_time(),
            serial=self.history.serial,
            action=action,
            who=self._who,
            run=self._run,
            table=table_id,
            replaced=replaced,
            reason=reason,
            facts=facts,
        )
        self._append(begin)
        try:
            yield change
        except BaseException as error:
            self._end(name, _result(change, error), _words(error))
            raise
        self._end(name, "in force", "")

    def seen(self, active: str | None) -> None:
        """Record which table the controller reports, if the end of the last change is uncertain."""
        with self._failures(self.history.file):
            entries, _ = self.history.read()
            if entries and entries[-1].result == "uncertain":
                self._append(Seen(time=calendar_time(), active=active))

    def _kept(self, table: TableFile | str | None) -> tuple[str | None, TableFacts | None]:
        """The id and the facts of a table; the copy of a file is written."""
        if not isinstance(table, TableFile):
            return table, self.history.facts(table)
        self._copy(table)
        return table.id, TableFacts.of(table)

    def _end(self, change: str, result: Result, reason: str) -> None:
        self._append(End(change=change, time=calendar_time(), result=result, reason=reason))

    def _append(self, line: Begin | End | Seen) -> None:
        with self._failures(self.history.file):
            self.history.folder.mkdir(parents=True, exist_ok=True)
            append_line(self.history.file, line.model_dump_json())

    def _copy(self, table: TableFile) -> None:
        file, text = self.history.copy_of(table.id), table.text()
        with self._failures(file):
            self.history.folder.mkdir(parents=True, exist_ok=True)
            if not file.exists() or file.read_bytes() != text.encode():
                write_atomically(file, text)

    @contextmanager
    def _failures(self, file: Path) -> Iterator[None]:
        """Keeps an OSError instead of raising it."""
        try:
            yield
        except OSError as error:
            cure = "free some space, or allow writing there; what happens on the controller does not depend on it"
            self.failure = f"{file}: the history of tables was not written: {error.strerror or error}\n    {cure}"


def user_here(name: str = "") -> str:
    """name@host; default: the user of this process, or the number of a user without a name, as in containers."""
    try:
        name = name or getpass.getuser()
    except (KeyError, OSError):
        name = str(os.getuid())
    return f"{name}@{socket.gethostname()}"


def _words(error: BaseException) -> str:
    return error.what if isinstance(error, DeviceError) else str(error) or f"interrupted ({type(error).__name__})"


def _result(change: Change, error: BaseException) -> Result:
    """Whether the new table is in force after `error`; a device that is lost before the activation kept the old one."""
    certain = isinstance(error, DeviceLost | DeviceRefused | LimitExceeded) and not isinstance(error, DeviceUncertain)
    if not certain:
        return "uncertain"
    return "in force" if change.activated else "not in force"
