"""The active table and the one before it, as they are remembered from one process to the next."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sims.krc.tables import Row, Table, Tables, table_sum


def state_of_tables(tables: Tables) -> dict[str, Any]:
    """As JSON has it. What is staged is not remembered."""
    return {"active": _told(tables.active), "previous": _told(tables.previous)}


def tables_from(state: Mapping[str, Any], axes: int) -> Tables:
    """The tables of a `state` that was kept. Raises ValueError, TypeError, LookupError, AttributeError."""
    return Tables(_table(state["active"], axes), _table(state["previous"], axes))


def _told(table: Table | None) -> dict[str, str] | None:
    return table and {"id": table.id, "sum": table.sum, "lines": table.lines}


def _table(state: Mapping[str, str] | None, axes: int) -> Table | None:
    if state is None:
        return None
    if table_sum(state["lines"]) != state["sum"]:
        raise ValueError(f"the sum of table '{state['id']}' does not fit")
    rows = tuple(_row(line.split(";")[1:], axes) for line in state["lines"].splitlines())
    return Table(state["id"], state["sum"], rows, state["lines"])


def _row(fields: list[str], axes: int) -> Row:
    angles = tuple(float(field) for field in fields)
    if len(angles) != 2 * axes:
        raise ValueError(f"a row has {len(angles)} angles, not {2 * axes}")
    return Row(angles[:axes], angles[axes:])
