"""History of the compensation tables of a controller: which one was put in force, when, by whom, from which run.

`RUNS/tables/SERIAL/` has `history.jsonl`, to which lines are only appended, and a copy of each table file, `ID.json`.
A change of the table in force is a line at its begin and one at its end. A begin without an end is uncertain.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import final
from urllib.parse import quote, unquote

from pydantic import ValidationError

from cellctl.files import InputError, Problem
from cellctl.formats import TableFile
from cellctl.operations.table_changes import Begin, End, Entry, Seen, TableFacts, entries_of, read_line, short

FOLDER = "tables"
"""Folder of all histories, among the run folders."""

_LISTED = 10
_SHA256 = re.compile("[0-9a-f]{64}")


@final
@dataclass(frozen=True, slots=True)
class TableHistory:
    """The history of controller `serial` in the folder of runs `runs`."""

    runs: Path
    serial: str

    @property
    def folder(self) -> Path:
        """Its folder; other characters of the serial than letters, digits, `_`, `-`, `~` and inner dots are `%XX`."""
        name = quote(self.serial, safe="")
        return self.runs / FOLDER / (f"%2E{name[1:]}" if name.startswith(".") else name)

    @property
    def file(self) -> Path:
        """The file of its lines."""
        return self.folder / "history.jsonl"

    def copy_of(self, table_id: str) -> Path:
        """The place of the copy of a table file."""
        return self.folder / f"{table_id}.json"

    def read(self) -> tuple[list[Entry], list[Problem]]:
        """The changes, oldest first, and the lines that cannot be read. Raises OSError."""
        problems: list[Problem] = []
        return entries_of(self._lines(problems)), problems

    def known(self) -> list[str]:
        """Ids of all tables of which the record or a copy exists, newest first."""
        recorded = [entry.begin.table for entry in reversed(self.read()[0]) if entry.begin.table]
        copies = [file.stem for file in sorted(self.folder.glob("*.json")) if _SHA256.fullmatch(file.stem)]
        return list(dict.fromkeys([*recorded, *copies]))

    def table(self, table_id: str) -> TableFile:
        """The copy of a table, its content checked. Raises InputError if it is missing, changed or another table."""
        file = self.copy_of(table_id)
        cure = "give the table's own file (`cellctl table push FILE`), or delete this copy and push it again"
        if not file.exists():
            raise InputError(Problem(str(file), 0, 0, "the history's copy of this table is missing", cure))
        try:
            found = TableFile.load(file)
        except InputError as error:
            problems = [Problem(each.file, each.line, each.column, each.what, cure) for each in error.problems]
            raise InputError(problems) from error
        if found.id != table_id:
            raise InputError(Problem(str(file), 0, 0, f"is table {short(found.id)}, not the one of its name", cure))
        return found

    def facts(self, table_id: str | None) -> TableFacts | None:
        """Facts of a table by its copy; None without a good copy."""
        try:
            return TableFacts.of(self.table(table_id)) if table_id and _SHA256.fullmatch(table_id) else None
        except (InputError, OSError):
            return None

    def _lines(self, problems: list[Problem]) -> Iterator[Begin | End | Seen]:
        try:
            texts = self.file.read_bytes().split(b"\n")
        except FileNotFoundError:
            return
        for number, text in enumerate(texts, 1):
            try:
                if text.strip():
                    yield read_line(text)
            except ValidationError as error:
                problems.append(_unreadable(self.file, number, error))


def histories(runs: Path) -> list[TableHistory]:
    """The histories of all controllers in the folder of runs."""
    return [TableHistory(runs, unquote(folder.name)) for folder in sorted((runs / FOLDER).glob("*/"))]


def table_named(name: Path, runs: Path) -> TableFile:
    """The table of a file, or where there is none, the one of any controller's history in `runs` whose id begins so.

    Raises InputError.
    """
    if name.exists() or not re.fullmatch("[0-9a-f]{1,64}", str(name)):
        return TableFile.load(name)
    history, table_id = find_table(str(name), histories(runs))
    return history.table(table_id)


def find_table(word: str, among: Iterable[TableHistory]) -> tuple[TableHistory, str]:
    """The only table whose id begins with `word`. Raises InputError with the candidates if it is not one."""
    known = [(history, table_id) for history in among for table_id in history.known()]
    found = [pair for pair in known if pair[1].startswith(word)]
    if len(found) == 1:
        return found[0]
    what = f"is the beginning of {len(found)} tables' ids" if found else "is the id of no table in this history"
    raise InputError(Problem(word, 0, 0, what, _candidates(found or known)))


def _candidates(known: list[tuple[TableHistory, str]]) -> str:
    if not known:
        return "the history is empty; give the folder of runs with --runs, or a table file"
    listed = [f"{short(table_id)} (controller {history.serial})" for history, table_id in known[:_LISTED]]
    more = f" and {len(known) - _LISTED} more" if len(known) > _LISTED else ""
    return f"give one of {', '.join(listed)}{more}"


def _unreadable(file: Path, number: int, error: ValidationError) -> Problem:
    first = error.errors(include_url=False)[0]
    place = ".".join(str(part) for part in first["loc"])
    what = f"this line of the history cannot be read: {f'{place}: ' if place else ''}{first['msg']}"
    return Problem(str(file), number, 0, what, "the other lines are used; restore the line from a copy")
