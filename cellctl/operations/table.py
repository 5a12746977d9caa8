"""Activates a compensation table on a controller: the checks, the push, and the comparison of the active table.

Commands and the steps of procedures push tables through this module alone.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import TypeAlias

from cellctl.devices import ControllerTable, DeviceFault, DeviceLost, Identity, TableRow, TableState, TableStore
from cellctl.files import InputError, Problem
from cellctl.formats import RobotFile, TableFile, table_problems
from cellctl.formats.table import JOINT_DECIMALS
from cellctl.operations.table_changes import Action
from cellctl.operations.table_recording import TableRecorder

_SHOWN = 5

_Before: TypeAlias = Callable[[], Awaitable[None]]


async def _nothing() -> None:
    """No action before the push."""


def controller_table(table: TableFile) -> ControllerTable:
    """`table` in the controller's form."""
    return ControllerTable(table.id, table.robot.serial, tuple(TableRow(*pair) for pair in table.pairs()))


def refuse_table(
    table: TableFile,
    file: Path,
    identity: Identity,
    robot: RobotFile,
    correction_deg: float,
    *,
    made: str | None = None,
) -> None:
    """Raise InputError with every reason why `table`, of `file`, must not go to the controller `identity` of `robot`.

    correction_deg: the largest allowed correction of a joint; made: the id that it must have, None: any.
    """
    serial, simulated = identity.serial, identity.simulated
    found = table_problems(table, serial=serial, simulated=simulated, robot=robot, correction_deg=correction_deg)
    if made is not None and made != table.id:
        found.insert(0, f"it is table {table.id[:12]}…, this run made {made[:12]}…")
    if found:
        raise InputError(Problem(str(file), 0, 0, f"is not pushed: {what}") for what in found)


async def push_verified(
    store: TableStore, table: TableFile, recorder: TableRecorder, action: Action = "push", before: _Before = _nothing
) -> None:
    """Activate `table` on the recorder's controller, read the active table and compare it, digit by digit.

    A table that is already active is not pushed again, as a rollback would then restore the same table.
    `before` is awaited before a push. The change is recorded as `action`. Raises DeviceFault if another table is active
    afterwards, DeviceLost if the connection ends after the push, and the store's errors.
    """
    state = await store.table_state()
    if in_force(state, table.id) and not state.staged:
        recorder.seen(table.id)
        await _read_back(store, table, recorder.history.serial)
        return
    await before()
    with recorder.change(action, table, active_id(state)) as change:
        await store.push_table(controller_table(table))
        change.activated = True
        await _read_back(store, table, recorder.history.serial)


async def roll_back(
    store: TableStore, state: TableState, recorder: TableRecorder, action: Action = "rollback", reason: str = ""
) -> TableState:
    """Activate the previous table of the controller, which is in `state`; returns the state afterwards.

    The change is recorded as `action`. Raises DeviceFault if the same table is active afterwards, and the store's
    errors.
    """
    if state.active is None and state.previous is None:
        return await store.rollback_table()  # it refuses; there is no change to record
    with recorder.change(action, state.previous.id if state.previous else None, active_id(state), reason):
        after = await store.rollback_table()
        if active_id(after) == active_id(state):
            raise DeviceFault(store.name, "it was pushed twice and is still in force after one rollback")
    return after


async def _read_back(store: TableStore, table: TableFile, serial: str) -> None:
    try:
        found = await store.read_table()
    except DeviceLost as error:
        what = f"table {table.id[:12]} is in force, but the connection was lost as it was read once more: {error.what}"
        raise DeviceLost(store.name, what, "look with `cellctl table verify`") from error
    if wrong := differences(controller_table(table), serial, found):
        what = f"after the push another table is in force than was pushed: {'; '.join(wrong)}"
        raise DeviceFault(store.name, what, "look with `cellctl table show`; `cellctl table rollback` undoes it")


def active_id(state: TableState) -> str | None:
    """The id of the controller's active table; None without one."""
    return state.active.id if state.active else None


def in_force(state: TableState, table_id: str) -> bool:
    """Whether the controller's active table is the one with this id."""
    return active_id(state) == table_id


def differences(wanted: ControllerTable, serial: str, found: ControllerTable | None) -> list[str]:
    """The difference of the active table on controller `serial` from `wanted`, as text; empty: all digits are equal."""
    if found is None:
        return ["no table is in force"]
    listed = []
    if wanted.serial != serial:
        listed.append(f"the file is for controller '{wanted.serial}', this one is '{serial}'")
    if wanted.id != found.id:
        listed.append(f"the one in force is {found.id[:12]}, the file's is {wanted.id[:12]}")
    if len(wanted.rows) != len(found.rows):
        listed.append(f"the one in force has {len(found.rows)} rows, the file's has {len(wanted.rows)}")
    pairs = enumerate(zip(wanted.rows, found.rows, strict=False), 1)
    rows = [number for number, (ours, theirs) in pairs if _digits(ours) != _digits(theirs)]
    if rows:
        more = f" and {len(rows) - _SHOWN} more" if len(rows) > _SHOWN else ""
        listed.append(f"other joints in row {', '.join(map(str, rows[:_SHOWN]))}{more}")
    return listed


def _digits(row: TableRow) -> tuple[str, ...]:
    """A row in wire format."""
    return tuple(f"{value + 0.0:.{JOINT_DECIMALS}f}" for value in (*row.nominal, *row.compensated))
