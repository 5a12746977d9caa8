"""State of the compensation table that a run pushed, from its journal."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self, final

from cellctl.records import Rows, TablePushRow, TableStateRow, VerdictRow


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
