"""From the run's table file to the controller, and the proof that it is there."""

from __future__ import annotations

from typing import Any

from cellctl.devices import ControllerTable, DeviceFault, TableRow, TableStore
from cellctl.devices.cell import table_correction_deg
from cellctl.files import InputError, Problem
from cellctl.formats import RobotFile, TableFile
from cellctl.formats.table_refusals import table_problems
from cellctl.procedure import StepContext


async def pushed_row(context: StepContext, robot: TableStore, table_id: str) -> dict[str, Any]:
    """Push the table in the run folder, read the active one back, compare; the row to record.

    Raises InputError where the file is not table `table_id` or must not go to this controller, DeviceFault where the
    controller holds something else, and what the device raises.
    """
    file = context.run_folder / "table.json"
    table = TableFile.load(file)
    identity = await robot.connect()
    problems = table_problems(
        table,
        serial=identity.serial,
        simulated=identity.simulated,
        robot=RobotFile.load(context.robot_file),
        correction_deg=table_correction_deg(context.cell),
    )
    if table.id != table_id:
        problems.insert(0, f"it is table {table.id[:12]}…, this run made {table_id[:12]}…")
    if problems:
        raise InputError(Problem(str(file), 0, 0, f"is not pushed: {problem}") for problem in problems)
    wanted = ControllerTable(table.id, table.robot.serial, tuple(TableRow(*pair) for pair in table.pairs()))
    state = await robot.push_table(wanted)
    held = await robot.read_table()
    active = state.active is not None and state.active.id == table.id
    if held != wanted or not active:
        cure = "look at the controller's tables: cellctl table show, cellctl table rollback"
        raise DeviceFault("robot", f"the table in force is not table {table.id[:12]}…, which was pushed", cure)
    return {
        "id": table.id,
        "rows": len(table.rows),
        "pushed": True,
        "verified": True,
        "active": True,
        "max_correction_deg": table.max_correction_deg,
    }
