"""History of a controller's compensation tables: which one was put in force, when, by whom, from which run.

`RUNS/tables/SERIAL/` has `history.jsonl`, to which lines are only appended, and a copy of each table file, `ID.json`.
A change of the table in force is a line at its begin and one at its end. A begin without an end is uncertain.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Literal, TypeAlias, final
from urllib.parse import quote, unquote

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from cellctl.devices import TableState
from cellctl.files import InputError, Problem
from cellctl.formats import TableFile

Action = Literal["push", "rollback", "withdrawal"]
Result = Literal["in force", "not in force", "uncertain"]

_SHORT = 12
_LINE = ConfigDict(strict=True, frozen=True)


@final
class TableFacts(BaseModel):
    """Facts of a table file: rows, largest correction (deg), hash of its model, method, run of its model."""

    model_config = _LINE
    rows: int
    max_correction_deg: float
    model_sha256: str
    method: str
    run: str | None

    @classmethod
    def of(cls, table: TableFile) -> TableFacts:
        """Of a table file."""
        return cls(
            rows=len(table.rows),
            max_correction_deg=table.max_correction_deg,
            model_sha256=table.source.model_sha256,
            method=table.source.method,
            run=table.source.run,
        )


@final
class Begin(BaseModel):
    """A change begins. change: its name; who: user@host; run: the campaign that makes it, None: a command.

    table: the id that is to be in force, None: no table; replaced: the id before it, as the controller reported it.
    facts: of `table`, None where its file is not in the history.
    """

    model_config = _LINE
    kind: Literal["begin"] = "begin"
    change: str
    time: str
    serial: str
    action: Action
    who: str
    run: str | None
    table: str | None
    replaced: str | None
    reason: str
    facts: TableFacts | None


@final
class End(BaseModel):
    """A change ended: whether its table is in force, and the error if there was one."""

    model_config = _LINE
    kind: Literal["end"] = "end"
    change: str
    time: str
    result: Result
    reason: str


@final
class Seen(BaseModel):
    """The table that a controller reported after a change whose end was uncertain."""

    model_config = _LINE
    kind: Literal["seen"] = "seen"
    time: str
    active: str | None


Line: TypeAlias = Annotated[Begin | End | Seen, Field(discriminator="kind")]
_LINES: TypeAdapter[Begin | End | Seen] = TypeAdapter(Line)


def read_line(text: bytes) -> Begin | End | Seen:
    """A line of a history file. Raises ValidationError."""
    return _LINES.validate_json(text)


@final
@dataclass(frozen=True, slots=True)
class TableChange:
    """A change of the table in force, as it is shown. rows to source_run: of its table, None where they are not known.

    state: see `Entry`; until, out_of_force: when and by what another table replaced it.
    """

    time: str
    serial: str
    action: Action
    who: str
    run: str | None
    table: str | None
    replaced: str | None
    rows: int | None
    max_correction_deg: float | None
    model_sha256: str | None
    method: str | None
    source_run: str | None
    state: str
    until: str | None
    out_of_force: str | None
    reason: str | None


@final
@dataclass(slots=True)
class Entry:
    """One change of the table in force. until: when another change ended it, `why_out`: by what."""

    begin: Begin
    result: Result = "uncertain"
    reason: str = "its end was not recorded: the process was killed, or could not write"
    until: str | None = None
    why_out: str = ""

    @property
    def state(self) -> str:
        """`in force`, `out of force`, `not in force` (the change failed) or `uncertain`."""
        return "out of force" if self.until and self.result == "in force" else self.result

    @property
    def reported(self) -> set[str | None]:
        """Ids of the tables one of which is in force after this change."""
        ids = {"in force": {self.begin.table}, "not in force": {self.begin.replaced}}
        return ids.get(self.result, {self.begin.table, self.begin.replaced})

    def settle(self, active: str | None) -> None:
        """An uncertain end becomes certain when the controller reports its `active` table."""
        if self.result == "uncertain" and active in self.reported:
            self.result = "in force" if active == self.begin.table else "not in force"
            self.reason = f"{self.reason}; the controller reported later which table is in force"

    @property
    def shown(self) -> TableChange:
        """With the facts of its table."""
        begin, facts = self.begin, self.begin.facts
        return TableChange(
            time=begin.time,
            serial=begin.serial,
            action=begin.action,
            who=begin.who,
            run=begin.run,
            table=begin.table,
            replaced=begin.replaced,
            rows=facts and facts.rows,
            max_correction_deg=facts and facts.max_correction_deg,
            model_sha256=facts and facts.model_sha256,
            method=facts and facts.method,
            source_run=facts and facts.run,
            state=self.state,
            until=self.until,
            out_of_force=self.why_out or None,
            reason="; ".join(text for text in (begin.reason, self.reason) if text) or None,
        )


def entries_of(lines: Iterable[Begin | End | Seen]) -> list[Entry]:
    """The changes, oldest first, of the lines of a history in their order."""
    entries: dict[str, Entry] = {}
    for line in lines:
        last = next(reversed(entries.values()), None)
        match line:
            case Begin():
                if last:
                    last.settle(line.replaced)
                entries[line.change] = Entry(line)
            case End() if line.change in entries:
                entry = entries[line.change]
                entry.result, entry.reason = line.result, line.reason
            case Seen() if last:
                last.settle(line.active)
    _end_each(list(entries.values()))
    return list(entries.values())


def _end_each(entries: list[Entry]) -> None:
    """Set until when and why each table was in force."""
    effective = [entry for entry in entries if entry.result != "not in force"]
    for old, new in pairwise(effective):
        if new.begin.replaced not in old.reported:
            found = f"table {short(new.begin.replaced)}" if new.begin.replaced else "no table"
            old.why_out = f"changed outside of cellctl: the controller had {found} in force before the next change"
        else:
            old.why_out = _why_out(new)
        old.until = new.begin.time


_WORDS: dict[Action, str] = {"push": "push of", "rollback": "rollback to", "withdrawal": "withdrawal, back to"}


def _why_out(new: Entry) -> str:
    begin = new.begin
    by = f" by run {begin.run}" if begin.run else ""
    certain = "" if new.result == "in force" else ", uncertain"
    reason = f": {begin.reason}" if begin.reason else ""
    return f"{_WORDS[begin.action]} {short(begin.table)}{by}{certain}{reason}"


def difference_from_controller(entries: list[Entry], state: TableState) -> str:
    """How the tables of the controller differ from those of the record, as a sentence; empty: they do not."""
    last = entries[-1] if entries else None
    active = state.active.id if state.active else None
    if active not in (last.reported if last else {None}):
        expected = " or ".join(short(table_id) for table_id in sorted(last.reported, key=str)) if last else "nothing"
        return f"the controller has {short(active)} in force, the record says {expected}"
    previous = state.previous.id if state.previous else None
    if last and last.result == "in force" and previous != last.begin.replaced:
        expected = short(last.begin.replaced)
        return f"the controller has {short(previous)} as the table before, the record says {expected}"
    return ""


def short(table_id: str | None) -> str:
    """A table's id as messages name it."""
    return table_id[:_SHORT] if table_id else "no table"


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


_TABLE = "table.json"


@final
@dataclass(frozen=True, slots=True)
class KnownTable:
    """A table of which the file is here."""

    id: str
    rows: int
    created: str
    simulated: bool
    robot: str
    method: str
    run: str | None
    max_correction_deg: float


@final
@dataclass(frozen=True, slots=True)
class ControllerTables:
    """The changes of a controller's table in force and the tables for it, newest first; lines that cannot be read."""

    serial: str
    changes: list[TableChange]
    unreadable: list[str]
    tables: list[KnownTable]

    @property
    def in_force(self) -> str | None:
        """The id of the table in force, as recorded; None for no table, or if it is not certain."""
        return self.changes[0].table if self.changes and self.changes[0].state == "in force" else None


def table_overview(runs: Path) -> list[ControllerTables]:
    """Each controller with a history or a table of a run, with its tables."""
    files = _of_runs(runs)
    known = {history.serial: history for history in histories(runs)}
    serials = [*known, *sorted({file.robot.serial for file in files} - set(known))]
    return [
        _one(TableHistory(runs, serial), [file for file in files if file.robot.serial == serial]) for serial in serials
    ]


def _one(history: TableHistory, of_runs: list[TableFile]) -> ControllerTables:
    entries, problems = history.read()
    tables = {file.id: file for file in of_runs}
    for table_id in history.known():
        try:
            tables.setdefault(table_id, history.table(table_id))
        except InputError:  # a table of which only the record is left
            continue
    return ControllerTables(
        history.serial,
        [entry.shown for entry in reversed(entries)],
        [str(problem) for problem in problems],
        sorted(map(_known_table, tables.values()), key=lambda table: table.created, reverse=True),
    )


def _known_table(file: TableFile) -> KnownTable:
    return KnownTable(
        id=file.id,
        rows=len(file.rows),
        created=file.created,
        simulated=file.simulated,
        robot=file.robot.name,
        method=file.source.method,
        run=file.source.run,
        max_correction_deg=file.max_correction_deg,
    )


def _of_runs(runs: Path) -> list[TableFile]:
    """The tables of run folders; those that cannot be read are left out."""
    found = []
    for path in sorted(runs.glob(f"*/{_TABLE}")):
        try:
            found.append(TableFile.load(path))
        except InputError:
            continue
    return found
