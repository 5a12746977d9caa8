"""The controller that stores a cell's tables: the device and its content."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self, TypeVar, final

from cellctl.devices import Identity, TableInfo, TableState, TableStore
from cellctl.devices.cell import Cell
from cellctl.devices.registry import DriverRegistry
from cellctl.files import InputError, Problem
from cellctl.formats import RobotFile, TableFile
from cellctl.operations.connected import connected
from cellctl.operations.system import require_cells
from cellctl.operations.table import push_verified, refuse_table
from cellctl.operations.table_changes import Action
from cellctl.operations.table_history import find_table
from cellctl.operations.table_recording import TableRecorder
from cellctl.procedure.check import missing_abilities

Result = TypeVar("Result")


@final
@dataclass(frozen=True)
class TableCell:
    """A cell with one device that stores tables; seed and memory are for its simulators."""

    cell: Cell
    robot: RobotFile
    drivers: DriverRegistry
    device: str
    seed: int | None
    state: Path | None

    @classmethod
    def load(cls, path: Path, seed: int | None, state: Path | None) -> Self:
        """Read and check the cell file; opens nothing. Raises InputError."""
        require_cells()
        drivers = DriverRegistry()
        cell = Cell.load(path, drivers)
        if state is not None and not cell.simulated:
            raise InputError(
                Problem("--state", 0, 0, "is a simulated cell's memory; this cell is real", "leave it out")
            )
        return cls(cell, RobotFile.load(cell.robot_file), drivers, _table_keeper(cell, drivers), seed, state)

    def carry_out(self, work: Callable[[TableStore, Identity], Awaitable[Result]]) -> Result:
        """The result of `work` on the connected device and its identity. Raises what it raises, and DeviceError."""

        async def go() -> Result:
            async with self.connected() as (store, identity):
                return await work(store, identity)

        return asyncio.run(go())

    @asynccontextmanager
    async def connected(self) -> AsyncIterator[tuple[TableStore, Identity]]:
        """The device, connected alone, and its identity."""
        extra = ("--state", str(self.state)) if self.state else ()
        async with connected(self.cell, self.drivers, [self.device], seed=self.seed, extra=extra) as devices:
            found = devices[self.device]
            yield found.device, found.identity


async def push_checked(
    store: TableStore,
    identity: Identity,
    table: TableFile,
    file: Path,
    place: TableCell,
    recorder: TableRecorder,
    action: Action = "push",
) -> dict[str, Any]:
    """Push `table`, of `file`, to the connected controller `identity`, and read it back after its activation.

    Raises InputError with every reason against this controller (nothing is written then), DeviceError.
    """
    refuse_table(table, file, identity, place.robot, place.cell.table_correction_deg)
    await push_verified(store, table, recorder, action)
    done = {"pushed": True, "verified": True, "active": True, "recorded": not recorder.failure}
    return {"id": table.id, "serial": identity.serial, "rows": len(table.rows), **done}


async def push_recorded(
    store: TableStore, identity: Identity, word: str, place: TableCell, recorder: TableRecorder
) -> dict[str, Any]:
    """`push_checked`, as a rollback, of the table in the recorder's history whose id begins with `word`.

    Raises InputError if there is none or more than one, or its copy has changed; and what `push_checked` raises.
    """
    history, table_id = find_table(word, [recorder.history])
    table = history.table(table_id)
    return await push_checked(store, identity, table, history.copy_of(table_id), place, recorder, "rollback")


def state_of(state: TableState) -> dict[str, Any]:
    """The tables of a controller, as JSON."""
    named = {"active": state.active, "previous": state.previous, "staged": state.staged}
    return {name: _info(info) for name, info in named.items()}


def _table_keeper(cell: Cell, drivers: DriverRegistry) -> str:
    """The only device of the cell that stores tables. Raises InputError."""
    kinds = {name: drivers.abilities(address.scheme) for name, address in cell.addresses.items()}
    names = [name for name, kind in kinds.items() if not missing_abilities(kind, TableStore)]
    if len(names) == 1:
        return names[0]
    what = (
        "has no device that keeps tables" if not names else f"has more than one that keeps tables: {', '.join(names)}"
    )
    raise InputError(cell.document.problem((), what, "one robot whose driver can push tables"))


def _info(info: TableInfo | None) -> dict[str, Any] | None:
    return None if info is None else {"id": info.id, "rows": info.rows, "checksum": info.checksum}
