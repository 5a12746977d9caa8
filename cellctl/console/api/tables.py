"""Compensation tables: history of each controller, differences, and push, verify and rollback."""

from __future__ import annotations

import asyncio
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Path, Query
from pydantic import BaseModel, Field

from cellctl.console.api.answers import COMMANDS, READS, Commander, Refused
from cellctl.console.api.runs import JobOut
from cellctl.console.commands import request_for, start_action, start_look
from cellctl.console.shared import console
from cellctl.operations.results import as_json
from cellctl.operations.table_actions import TableRequest, known_table
from cellctl.operations.table_diff import ComparedTable, TableDifference, table_difference
from cellctl.operations.table_history import histories, table_overview

router = APIRouter(prefix="/api/tables", tags=["tables"])

_Id = Annotated[str, Query(description="Id of a table (SHA-256, hex)")]


class TableAsked(BaseModel):
    """An action on the table of a cell's controller."""

    action: Literal["push", "verify", "rollback"]
    cell: str = Field(default="", description="Cell file or shipped name; empty: the cell of this console")
    table: str = Field(default="", description="Id (SHA-256, hex) of the table; empty for a rollback to the one before")
    state: str = Field(default="", description="Of a simulated cell: the run whose memory it continues")


class TableConfirmed(TableAsked):
    """A change, confirmed by a person who has seen the difference."""

    seen: str = Field(default="", description="Id of the table in force that was shown; empty for none")
    confirmed: str = Field(description="The controller's serial, or the first 8 or more characters of the table's id")


@router.get("")
async def list_tables() -> list[dict[str, Any]]:
    """The history of each controller: changes of the table in force, newest first, and the tables known for it."""
    return [as_json(each) for each in await asyncio.to_thread(table_overview, console().runs)]


@router.get("/diff", responses=READS)
async def diff(a: _Id, b: _Id) -> dict[str, Any]:
    """Difference of two tables, by their ids: facts, and rows with changed joints (deg)."""

    def found() -> TableDifference:
        tables = [ComparedTable.of_file(each[:12], known_table(console().runs, each)) for each in (a, b)]
        return table_difference(tables[0], tables[1], None)

    return as_json(await asyncio.to_thread(found))


@router.get("/{serial}", responses=READS)
async def history(serial: Annotated[str, Path(description="Serial number of the controller")]) -> dict[str, Any]:
    """The history of one controller."""
    for each in await asyncio.to_thread(table_overview, console().runs):
        if each.serial == serial:
            return as_json(each)
    known = ", ".join(each.serial for each in histories(console().runs)) or "none"
    raise Refused(404, f"no table is recorded for controller '{serial[:80]}'", f"recorded controllers: {known}")


@router.post("/look", status_code=202, responses=COMMANDS)
async def look(operator: Commander, asked: TableAsked) -> JobOut:
    """Connect to the controller, and show what the action would change; changes nothing."""
    return JobOut(job=(await start_look(operator, _request(asked))).id)


@router.post("/act", status_code=202, responses=COMMANDS)
async def act(operator: Commander, asked: TableConfirmed) -> JobOut:
    """Push, verify or roll back; a change needs a look before it, what was seen then, and a confirmation."""
    request = _request(asked, seen=asked.seen, confirmed=asked.confirmed)
    return JobOut(job=(await start_action(operator, request)).id)


def _request(asked: TableAsked, **more: str) -> TableRequest:
    return request_for(asked.action, asked.cell, asked.table, asked.state, **more)
