"""The run's table: push from its file to the controller, check of the active table, and rollback."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import TypeVar

from cellctl.devices import DeviceError, DeviceRefused, DeviceUncertain, TableStore, table_correction_deg
from cellctl.formats import RobotFile, TableFile
from cellctl.journal import PushedTable
from cellctl.operations.campaign_services import (
    TableHistory,
    TableRecorder,
    active_id,
    in_force,
    push_verified,
    refuse_table,
    roll_back,
)
from cellctl.procedure import StepContext
from cellctl.records import TablePushRow, TableStateRow, VerdictRow

AnyVerdict = TypeVar("AnyVerdict", bound=VerdictRow)


@contextmanager
def recorded_changes(context: StepContext) -> Iterator[TableRecorder]:
    """Records in the history of the run's controller, beside the run folder; a failure to write is only reported."""
    history = TableHistory(context.run_folder.parent, context.identity("robot").serial)
    recorder = TableRecorder(history, context.run_name, context.operator)
    try:
        yield recorder
    finally:
        if recorder.failure:
            context.say(recorder.failure)


async def pushed_row(context: StepContext, robot: TableStore, table_id: str) -> TableStateRow:
    """Push the table in the run folder, read the active one back, compare; the row to record.

    A `TablePushRow` is recorded before: after an interruption of the push, it names the table that may be active. If
    the table is already active (a resumed run) it is not pushed again: a rollback would restore the same table.

    Raises InputError if the file is not table `table_id` or must not go to this controller, DeviceFault if the
    controller has another table, and the device's errors.
    """
    file = context.run_folder / "table.json"
    table, identity = TableFile.load(file), context.identity("robot")
    limit = table_correction_deg(context.cell)
    refuse_table(table, file, identity, RobotFile.load(context.robot_file), limit, made=table_id)
    begins = TablePushRow(table.id, len(table.rows), False, False, None, table.max_correction_deg)
    with recorded_changes(context) as recorder:
        await push_verified(robot, table, recorder, before=lambda: context.record(begins))
    return TableStateRow(table.id, len(table.rows), True, True, True, table.max_correction_deg)


async def push_of_run(context: StepContext, table_id: str) -> None:
    """Push the run's table, record its row, and tell the operator. Raises as `pushed_row`."""
    row = await pushed_row(context, context.device("robot"), table_id)
    await context.record(row)
    context.say(f"table {row.short} is in force: {row.rows} rows, read back letter for letter")


async def push_unless_judged(context: StepContext, table_id: str | None, judged: Sequence[VerdictRow]) -> bool:
    """`push_of_run` of a table that no verdict has `judged`; whether the run's table is active. Raises as it does."""
    if table_id is None or judged:
        return any(verdict.better for verdict in judged)
    await push_of_run(context, table_id)
    return True


async def require_in_force(robot: TableStore, table_id: str) -> None:
    """Raise DeviceRefused if the run's table is not active: another table's rows have other targets."""
    if not in_force(await robot.table_state(), table_id):
        cure = "Run the procedure anew; one whose push has `on_resume: always` can be resumed after its clean-up."
        raise DeviceRefused("robot", f"table {table_id[:12]} of this run is not in force; nothing was moved", cure)


async def take_back(context: StepContext, robot: TableStore, row: TableStateRow, reason: str) -> TableStateRow:
    """Activate the table before the run's one, whose last row is `row`; records the new state and returns its row.

    No action if the run's table is not active. `reason` is for the history. Raises DeviceUncertain if the table may
    still be active afterwards.
    """
    try:
        with recorded_changes(context) as recorder:
            state = await robot.table_state()
            if in_force(state, row.id):
                await roll_back(robot, state, recorder, "withdrawal", reason)
            else:
                recorder.seen(active_id(state))
    except DeviceError as error:
        await context.record(_of_table(row, active=None))
        what = f"table {row.short} was pushed by this run, is not proved, and may still be in force"
        raise DeviceUncertain("robot", f"{what}: {error.what}", error.cure) from error
    taken = _of_table(row, active=False)
    await context.record(taken)
    return taken


async def take_back_unhelpful(context: StepContext, robot: TableStore) -> TableStateRow:
    """Activate the table before the run's one, which is not better than nominal; returns its row.

    Raises DeviceUncertain if it may still be active.
    """
    row = await take_back(context, robot, context.recorded(TableStateRow)[-1], "it is not better than nominal")
    context.say(f"table {row.short} is not better than nominal: rolled back, no longer in force")
    return row


async def withdrawn_unless_better(context: StepContext, found: AnyVerdict) -> AnyVerdict:
    """The verdict `found`; if it is not better, the run's table is withdrawn. Raises as `take_back_unhelpful`."""
    if found.better or not context.recorded(TableStateRow):
        return found
    return replace(found, table=await take_back_unhelpful(context, context.device("robot")))


async def take_back_unproved(context: StepContext, robot: TableStore) -> None:
    """`take_back` of a table that this run pushed and has not proved; no action if there is none."""
    table = PushedTable.of(context)
    if table is not None and table.unproved_in_force:
        await take_back(context, robot, table.row, "the run ended before it was proved")
        context.say(f"table {table.row.short} is not proved and no longer in force: the one before it is")


def _of_table(row: TableStateRow, active: bool | None) -> TableStateRow:
    """A `TableStateRow` with the fields of `row`, which may be that of a push, and another `active`."""
    return TableStateRow(**{**row.data(), "active": active})
