"""Changes of the compensation table in force on a controller, as lines of its history, and what follows from them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated, Any, Literal, TypeAlias, final

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter

from cellctl.devices import TableState
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

    def to_json(self) -> dict[str, Any]:
        """As `cellctl table history --json` shows it."""
        begin = self.begin.model_dump(exclude={"kind", "change", "facts", "reason"})
        facts = self.begin.facts.model_dump() if self.begin.facts else dict.fromkeys(TableFacts.model_fields)
        facts["source_run"] = facts.pop("run")
        ends = {"state": self.state, "until": self.until, "out_of_force": self.why_out or None}
        reason = "; ".join(text for text in (self.begin.reason, self.reason) if text)
        return {**begin, **facts, **ends, "reason": reason or None}


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
            old.why_out = f"not by a recorded change: {short(new.begin.replaced)} was in force before the next one"
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
