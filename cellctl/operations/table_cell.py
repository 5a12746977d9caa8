"""The controller that keeps a cell's tables: which device it is, what may be pushed to it, what it holds."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self, final

from cellctl.devices import (
    ControllerTable,
    DeviceFault,
    DeviceLost,
    Identity,
    TableInfo,
    TableRow,
    TableState,
    TableStore,
)
from cellctl.devices.cell import Cell
from cellctl.devices.registry import DriverRegistry
from cellctl.files import InputError, Problem
from cellctl.formats import RobotFile, TableFile, table_problems
from cellctl.formats.table import JOINT_DECIMALS
from cellctl.operations.connected import connected
from cellctl.procedure.abilities import missing_abilities

_SHOWN = 5


@final
@dataclass(frozen=True)
class TableCell:
    """A cell with one device that keeps tables; seed and memory are for its simulators."""

    cell: Cell
    robot: RobotFile
    drivers: DriverRegistry
    device: str
    seed: int | None
    state: Path | None

    @classmethod
    def load(cls, path: Path, seed: int | None, state: Path | None) -> Self:
        """Read and check the cell file; opens nothing. Raises InputError."""
        drivers = DriverRegistry()
        cell = Cell.load(path, drivers)
        if state is not None and not cell.simulated:
            raise InputError(
                Problem("--state", 0, 0, "is a simulated cell's memory; this cell is real", "leave it out")
            )
        return cls(cell, RobotFile.load(cell.robot_file), drivers, _table_keeper(cell, drivers), seed, state)

    @asynccontextmanager
    async def connected(self) -> AsyncIterator[tuple[TableStore, Identity]]:
        """The device, connected alone, and who it says it is."""
        extra = ("--state", str(self.state)) if self.state else ()
        async with connected(self.cell, self.drivers, [self.device], seed=self.seed, extra=extra) as devices:
            found = devices[self.device]
            yield found.device, found.identity


def controller_table(table: TableFile) -> ControllerTable:
    """`table` as a controller takes it."""
    return ControllerTable(table.id, table.robot.serial, tuple(TableRow(*pair) for pair in table.pairs()))


async def push_checked(
    store: TableStore, who: Identity, table: TableFile, file: str, place: TableCell
) -> dict[str, Any]:
    """Push `table`, of `file`, to the connected controller `who`, and read it once more after it came into force.

    Raises InputError with every reason why it is not for this controller (nothing is written then), DeviceError.
    """
    limit = place.cell.table_correction_deg
    found = table_problems(table, serial=who.serial, simulated=who.simulated, robot=place.robot, correction_deg=limit)
    if found:
        raise InputError(Problem(file, 0, 0, what) for what in found)
    wanted = controller_table(table)
    await store.push_table(wanted)
    wrong = differences(wanted, who.serial, await _read_again(store, wanted))
    if wrong:
        what = f"after the push another table is in force than was pushed: {'; '.join(wrong)}"
        raise DeviceFault(store.name, what, "look with `cellctl table show`; `cellctl table rollback` undoes it")
    done = {"pushed": True, "verified": True, "active": True}
    return {"id": table.id, "serial": who.serial, "rows": len(table.rows), **done}


async def _read_again(store: TableStore, table: ControllerTable) -> ControllerTable | None:
    """What is in force after `table` was pushed. Raises DeviceLost that says so where the connection ends just then."""
    try:
        return await store.read_table()
    except DeviceLost as error:
        what = f"table {table.id[:12]} is in force, but the connection was lost as it was read once more: {error.what}"
        raise DeviceLost(store.name, what, "look with `cellctl table verify`") from error


def differences(wanted: ControllerTable, serial: str, found: ControllerTable | None) -> list[str]:
    """In words, what the active table of controller `serial` has otherwise than `wanted`; empty: letter for letter."""
    if found is None:
        return ["no table is in force"]
    said = []
    if wanted.serial != serial:
        said.append(f"the file is for controller '{wanted.serial}', this one is '{serial}'")
    if wanted.id != found.id:
        said.append(f"the one in force is {found.id[:12]}, the file's is {wanted.id[:12]}")
    if len(wanted.rows) != len(found.rows):
        said.append(f"the one in force has {len(found.rows)} rows, the file's has {len(wanted.rows)}")
    pairs = enumerate(zip(wanted.rows, found.rows, strict=False), 1)
    rows = [number for number, (ours, theirs) in pairs if _letters(ours) != _letters(theirs)]
    if rows:
        more = f" and {len(rows) - _SHOWN} more" if len(rows) > _SHOWN else ""
        said.append(f"other joints in row {', '.join(map(str, rows[:_SHOWN]))}{more}")
    return said


def state_of(state: TableState) -> dict[str, Any]:
    """What tables a controller has, as JSON."""
    named = {"active": state.active, "previous": state.previous, "staged": state.staged}
    return {name: _info(info) for name, info in named.items()}


def _table_keeper(cell: Cell, drivers: DriverRegistry) -> str:
    """The one device of the cell that keeps tables. Raises InputError."""
    kinds = {name: drivers.kind(address.scheme) for name, address in cell.addresses.items()}
    names = [name for name, kind in kinds.items() if not missing_abilities(kind, TableStore)]
    if len(names) == 1:
        return names[0]
    what = (
        "has no device that keeps tables" if not names else f"has more than one that keeps tables: {', '.join(names)}"
    )
    raise InputError(cell.document.problem((), what, "one robot whose driver can push tables"))


def _letters(row: TableRow) -> tuple[str, ...]:
    """A row as the wire writes it."""
    return tuple(f"{value + 0.0:.{JOINT_DECIMALS}f}" for value in (*row.nominal, *row.compensated))


def _info(info: TableInfo | None) -> dict[str, Any] | None:
    return None if info is None else {"id": info.id, "rows": info.rows, "checksum": info.checksum}
