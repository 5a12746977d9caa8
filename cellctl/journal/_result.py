"""The result of a run, and the state of the compensation table that it pushed, from its journal."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Self, final

from cellctl.journal._state import RunState
from cellctl.records import Figures, Json, Rows, TablePushRow, TableStateRow, VerdictRow


@final
@dataclass(frozen=True, slots=True)
class PushedTable:
    """The table that a run pushed. row: the last one recorded of it; proved: the run's verdict on it is `better`."""

    row: TableStateRow
    proved: bool

    @classmethod
    def of(cls, run: Rows) -> Self | None:
        """From the rows of a run, including failed attempts; None if no table was pushed."""
        rows = run.all_recorded(TablePushRow, TableStateRow)
        if not rows:
            return None
        last = rows[-1]
        judged = [each.better for each in run.recorded(VerdictRow) if each.table and each.table.id == last.id]
        return cls(last, bool(judged) and judged[-1])

    @property
    def state(self) -> str:
        """`taken back`, `proved`, or `not proved, may be in force`."""
        if self.row.active is False:
            return "taken back"
        return "proved" if self.proved else "not proved, may be in force"

    @property
    def unproved_in_force(self) -> bool:
        """Whether it may be in force now although this run has not proved it."""
        return not self.proved and self.row.active is not False

    def words(self) -> str:
        """Its state, as a sentence without a full stop."""
        table = f"table {self.row.short}"
        if self.row.active is False:
            return f"{table} was rolled back: the table before it is in force again"
        if self.proved:
            return f"{table} is in force; this run proved it"
        return f"{table} was pushed by this run, is not proved, and may be in force on the controller"


@final
@dataclass(frozen=True, slots=True, kw_only=True)
class RunResult:
    """The result of a run: the fields common to all campaigns, and the section of this kind.

    verdict, sentence, before, after, model: of the last verdict, None if there is none (see `VerdictRow`). points:
    measurements that count. table: the one that the run pushed. section: the fields of the campaign's own kind, each
    None if the run did not get that far. lines: for the operator, below the sentence. simulated_s: of the cell's
    time; wall_s: 0 if not measured.
    """

    run: str
    state: str
    verdict: str | None = None
    sentence: str | None = None
    points: int
    before: Figures | None = None
    after: Figures | None = None
    model: Mapping[str, Json] | None = None
    table: PushedTable | None
    section: Mapping[str, Json]
    error: str | None = None
    simulated_s: float
    wall_s: float = 0.0
    lines: tuple[str, ...] = ()

    @classmethod
    def of(cls, run: str, journal: RunState, **known: Any) -> Self:
        """The result of `run` (its name) by its `journal`; `known`: fields that the caller overrides."""
        verdict = journal.last(VerdictRow)
        content: Mapping[str, Json] = next(reversed(journal.data_of(VerdictRow.KIND)), {})
        common = ("verdict", "sentence", "before", "after", "model", "lines")
        found: dict[str, Any] = {
            "run": run,
            "state": journal.state,
            "points": journal.measurements,
            "table": PushedTable.of(journal),
            "section": {name: content.get(name) for name in journal.section},
            "simulated_s": (journal.last_ns - journal.first_ns) * 1e-9,
            **({name: getattr(verdict, name) for name in common} if verdict else {}),
        }
        return cls(**(found | known))

    @property
    def table_data(self) -> dict[str, Json] | None:
        """The table that the run pushed, with its state, as JSON has it."""
        return {**self.table.row.data(), "state": self.table.state} if self.table else None

    def to_json(self) -> dict[str, Json]:
        """As `cellctl run --json` prints it: the fields of the section follow the table."""
        content: dict[str, Json] = asdict(self)
        section, _ = content.pop("section"), content.pop("lines")
        content["table"] = self.table_data
        times = {name: round(content.pop(name), 3) for name in ("simulated_s", "wall_s")}
        error = content.pop("error")
        return {**content, **section, "error": error, **times}
