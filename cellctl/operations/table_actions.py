"""Pushes, verifies and rolls back a controller's table for a person who has seen the difference first.

`look` connects and shows what would change. A change needs what was seen and a typed confirmation, so that none is made
by a slip of the hand, nor against another table than the person saw.
"""

from __future__ import annotations

import re
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeAlias, final

from cellctl.devices import ControllerTable, Identity, TableInfo, TableState, TableStore
from cellctl.files import InputError, Problem
from cellctl.formats import TableFile, table_problems
from cellctl.operations.cell_state import run_on
from cellctl.operations.table import (
    Pushed,
    RolledBack,
    TableCell,
    TableRecorder,
    Verified,
    active_id,
    controller_table,
    differences,
    push_checked,
    rolled_back,
    verified,
)
from cellctl.operations.table_diff import ComparedTable, TableDifference, table_difference
from cellctl.operations.table_history import TableHistory, difference_from_controller, short

Action: TypeAlias = Literal["push", "verify", "rollback"]

_SHORTEST = 8
"""Characters of a table's id that confirm it."""


@final
@dataclass(frozen=True, slots=True)
class TableRequest:
    """What is asked of the controller of a cell. cell: its file; runs: the folder of runs, with the history.

    table: id (SHA-256, hex) of a table in the history or in a run folder; empty for a rollback to the table before.
    seed, state: of a simulated cell. who: the person, for the history. seen: id of the active table that the person was
    shown, empty for none. confirmed: what the person typed.
    """

    action: Action
    cell: Path
    runs: Path
    table: str = ""
    seed: int | None = None
    state: Path | None = None
    who: str = ""
    seen: str = ""
    confirmed: str = ""


@final
@dataclass(frozen=True, slots=True)
class TableLook:
    """What an action would change. active, previous, staged: the controller's tables.

    record: how they differ from the history; target: id of the table that the action is about; refused: why it must not
    be pushed; difference: from the active table to the target, None where the rows of one are not known.
    """

    serial: str
    simulated: bool
    active: TableInfo | None
    previous: TableInfo | None
    staged: TableInfo | None
    record: str
    target: str | None
    refused: list[str]
    difference: TableDifference | None


Acted: TypeAlias = Pushed | RolledBack | Verified


def look(request: TableRequest) -> TableLook:
    """Connect, and show what the action would change; changes nothing. Raises InputError, DeviceError."""
    place = _place(request)
    target = _target(request)

    async def work(store: TableStore, identity: Identity) -> TableLook:
        state, active = await store.table_state(), await store.read_table()
        history = TableHistory(request.runs, identity.serial)
        wanted = target or _previous(state, history)
        return TableLook(
            serial=identity.serial,
            simulated=identity.simulated,
            active=state.active,
            previous=state.previous,
            staged=state.staged,
            record=difference_from_controller(history.read()[0], state),
            target=wanted.id if wanted else state.previous.id if state.previous else None,
            refused=_refused(target, identity, place) if target else [],
            difference=_compared(active, wanted, history, place),
        )

    return place.carry_out(work)


def act(request: TableRequest) -> Acted:
    """Push, verify or roll back. Raises InputError (nothing was written), DeviceError."""
    place = _place(request)
    target = _target(request)
    work = {"push": _push, "verify": _verify, "rollback": _rollback}[request.action]
    return place.carry_out(work(request, place, target))


_Work: TypeAlias = Callable[[TableStore, Identity], Awaitable[Acted]]


def _push(request: TableRequest, place: TableCell, target: TableFile | None) -> _Work:
    async def work(store: TableStore, identity: Identity) -> Acted:
        assert target is not None
        state = await store.table_state()
        _refuse_change(request, identity.serial, target.id, state)
        recorder = _recorder(request, identity.serial)
        file = recorder.history.copy_of(target.id)
        action: Literal["push", "rollback"] = "rollback" if request.action == "rollback" else "push"
        return await push_checked(store, identity, target, file, place, recorder, action)

    return work


def _rollback(request: TableRequest, place: TableCell, target: TableFile | None) -> _Work:
    if target is not None:
        return _push(request, place, target)

    async def work(store: TableStore, identity: Identity) -> Acted:
        state = await store.table_state()
        _refuse_change(request, identity.serial, state.previous.id if state.previous else "", state)
        recorder = _recorder(request, identity.serial)
        return await rolled_back(store, identity.serial, state, recorder)

    return work


def _verify(request: TableRequest, place: TableCell, target: TableFile | None) -> _Work:
    async def work(store: TableStore, identity: Identity) -> Acted:
        assert target is not None
        return await verified(store, identity.serial, controller_table(target))

    return work


def _place(request: TableRequest) -> TableCell:
    """The cell; refuses one on which a run is active."""
    if active := run_on(request.cell, request.runs):
        what = f"run {active} is active on this cell, and holds its controller"
        raise InputError(Problem(str(request.cell), 0, 0, what, "wait until the run has ended, or abort it"))
    return TableCell.load(request.cell, request.seed, request.state)


def _target(request: TableRequest) -> TableFile | None:
    """The table of the request; None for a rollback to the table before."""
    if request.table:
        return known_table(request.runs, request.table)
    if request.action == "rollback":
        return None
    raise InputError(Problem("table", 0, 0, f"is needed for a {request.action}", "choose a table"))


def known_table(runs: Path, table_id: str) -> TableFile:
    """The table with this id in a history or a run folder of `runs`, checked. Raises InputError if there is none."""
    if re.fullmatch("[0-9a-f]{64}", table_id):
        for file in (*runs.glob(f"tables/*/{table_id}.json"), *runs.glob("*/table.json")):
            if file.stem == table_id or _id_in(file) == table_id:
                return _checked(file, table_id)
    raise InputError(Problem(table_id[:80], 0, 0, "is the id of no table here", "choose a table of the list"))


def _checked(file: Path, table_id: str) -> TableFile:
    found = TableFile.load(file)
    if found.id != table_id:
        raise InputError(Problem(str(file), 0, 0, f"is table {short(found.id)}, not the one of its name", ""))
    return found


def _id_in(file: Path) -> str:
    try:
        return TableFile.load(file).id
    except InputError:
        return ""


def _refused(target: TableFile, identity: Identity, place: TableCell) -> list[str]:
    """Why the table must not go to this controller."""
    limit = place.cell.table_correction_deg
    serial, simulated = identity.serial, identity.simulated
    return table_problems(target, serial=serial, simulated=simulated, robot=place.robot, correction_deg=limit)


def _refuse_change(request: TableRequest, serial: str, target: str, state: TableState) -> None:
    """Raise InputError unless the person saw the table in force now, and confirmed by serial or id."""
    if (active_id(state) or "") != request.seen:
        what = f"{short(active_id(state))} is in force now; you were shown {short(request.seen or None)}"
        raise InputError(Problem(f"controller {serial}", 0, 0, what, "look at the difference again"))
    refuse_confirmation(request.confirmed, serial, target)


def refuse_confirmation(typed: str, serial: str, target: str) -> None:
    """Raise InputError unless `typed` is the controller's serial, or begins the id `target` (may be empty)."""
    given = typed.strip()
    by_id = len(given) >= _SHORTEST and bool(target) and target.startswith(given.lower())
    if given != serial and not by_id:
        cure = f"type the controller's serial, {serial}" + (f", or the table's id, {short(target)}" if target else "")
        raise InputError(Problem("confirmation", 0, 0, "is not the serial or the table", cure))


def _recorder(request: TableRequest, serial: str) -> TableRecorder:
    return TableRecorder(TableHistory(request.runs, serial), who=request.who)


def _previous(state: TableState, history: TableHistory) -> TableFile | None:
    """The table before, by its copy in the history; None without a good copy."""
    try:
        return history.table(state.previous.id) if state.previous else None
    except InputError:
        return None


def _compared(
    active: ControllerTable | None, wanted: TableFile | None, history: TableHistory, place: TableCell
) -> TableDifference | None:
    """The difference from the active table to the wanted one; None without one of them."""
    name = "the table in force"
    if active is None or wanted is None:
        return None
    try:
        file = history.table(active.id)
        same = not differences(controller_table(file), history.serial, active)
        first = ComparedTable.of_file(name, file) if same else ComparedTable.of_controller(name, active)
    except InputError:
        first = ComparedTable.of_controller(name, active)
    second = ComparedTable.of_file(short(wanted.id), wanted)
    robot = place.robot if wanted.robot.name == place.robot.name else None
    return table_difference(first, second, robot)
