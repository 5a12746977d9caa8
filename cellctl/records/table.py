"""Rows about the compensation table that a run pushes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, final

from cellctl.records.row import Row


@dataclass(frozen=True)
class TableStateRow(Row):
    """State of a table: its id, number of rows, largest correction of a joint (deg).

    active: whether it is in force; None if a push or a rollback was begun and its end is unknown.
    """

    KIND: ClassVar[str] = "table"
    id: str
    rows: int
    pushed: bool
    verified: bool
    active: bool | None
    max_correction_deg: float

    @property
    def short(self) -> str:
        """The beginning of its id, as messages name it."""
        return self.id[:12]


@final
@dataclass(frozen=True)
class TablePushRow(TableStateRow):
    """A push begins. Until a `TableStateRow` follows, this table or the previous one may be active."""

    KIND: ClassVar[str] = "push"
