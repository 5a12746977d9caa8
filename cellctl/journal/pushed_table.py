"""What became of the compensation table that a run pushed, as its journal tells it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, Self, final

from cellctl.journal.state import RunState

PUSH_ROWS: Final = ("push", "table")
"""Kinds of rows about a table: a push begins; what is in force, or not any more."""


@final
@dataclass(frozen=True, slots=True)
class PushedTable:
    """The table that a run pushed. row: the last one recorded of it; proved: the run's verdict on it is `better`.

    `row["active"]`: whether it was in force then; None where a push or a rollback began and its end is not recorded.
    """

    row: Mapping[str, Any]
    proved: bool

    @classmethod
    def of(cls, rows: Sequence[Mapping[str, Any]], verdicts: Sequence[Mapping[str, Any]]) -> Self | None:
        """From the `PUSH_ROWS` of every attempt and the `verdict` rows that count; None where nothing was pushed."""
        if not rows:
            return None
        last = rows[-1]
        judged = [verdict for verdict in verdicts if (verdict.get("table") or {}).get("id") == last["id"]]
        return cls(last, bool(judged) and judged[-1]["verdict"] == "better")

    @classmethod
    def of_run(cls, state: RunState) -> Self | None:
        """From all that a run's journal holds."""
        return cls.of(state.all_recorded(*PUSH_ROWS), state.recorded("verdict"))

    @property
    def short(self) -> str:
        """The beginning of its id, as messages name it."""
        return str(self.row["id"])[:12]

    @property
    def state(self) -> str:
        """`taken back`, `proved`, or `not proved, may be in force`."""
        if self.row.get("active") is False:
            return "taken back"
        return "proved" if self.proved else "not proved, may be in force"

    @property
    def unproved_in_force(self) -> bool:
        """Whether it may be in force now although this run has not proved it."""
        return not self.proved and self.row.get("active") is not False

    def words(self) -> str:
        """What became of it, in a sentence without a full stop."""
        if self.row.get("active") is False:
            return f"table {self.short} was taken back: what was in force before it is in force again"
        if self.proved:
            return f"table {self.short} is in force; this run proved it"
        return f"table {self.short} was pushed by this run, is not proved, and may be in force on the controller"
