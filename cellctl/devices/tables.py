"""Compensation tables on a controller: staged, read back, compared, activated at once, rolled back."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, final, runtime_checkable

from cellctl.devices.protocols import Device, JointReadings, MovingRobot, SearchingRobot


@final
@dataclass(frozen=True, slots=True)
class TableRow:
    """A target's joints, degrees: from the nominal model, and compensated."""

    nominal: JointReadings
    compensated: JointReadings


@final
@dataclass(frozen=True, slots=True)
class ControllerTable:
    """A table in the controller's form: `id` of the table file, `serial` of the controller that it was made for."""

    id: str
    serial: str
    rows: tuple[TableRow, ...]


@final
@dataclass(frozen=True, slots=True)
class TableInfo:
    """A table that a controller has: its id, how many of its rows are there, and the check sum over them.

    The check sum is empty for a staged table, which may be incomplete.
    """

    id: str
    rows: int
    checksum: str


@final
@dataclass(frozen=True, slots=True)
class TableState:
    """The tables of a controller: active, previous, and the number of rows received of a staged one."""

    active: TableInfo | None
    previous: TableInfo | None
    staged: TableInfo | None


@runtime_checkable
class TableStore(Device, Protocol):
    """A controller that keeps compensation tables and moves to their rows."""

    async def push_table(self, table: ControllerTable) -> TableState:
        """Stage in blocks, read every row back, compare, activate in one step; the old table is active until then.

        Raises DeviceRefused (another serial or check sum, too many rows), DeviceFault (rows read back differ),
        DeviceLost (before the activation: the old table is active), DeviceUncertain (lost during the activation:
        either complete table may be active; `table_state` reports which).
        """

    async def table_state(self) -> TableState:
        """The controller's tables. Raises DeviceRefused, DeviceLost."""

    async def read_table(self) -> ControllerTable | None:
        """The active table, row by row as the controller stores it; None without one.

        Raises DeviceRefused (blocked by a staged, never activated table), DeviceFault (its rows do not match its
        check sum), DeviceLost.
        """

    async def rollback_table(self) -> TableState:
        """Activate the previous table again.

        Raises DeviceRefused if there is no table to roll back, DeviceLost, DeviceUncertain (lost after the request).
        """

    async def move_to_row(self, row: int, speed_percent: float) -> JointReadings:
        """Point to point to the compensated joints of `row` (from 1) of the active table; raises as `move` does."""


@runtime_checkable
class TableRobot(MovingRobot, TableStore, Protocol):
    """A robot that moves from point to point, and whose controller moves it to the rows of a compensation table."""


@runtime_checkable
class CompensatedRobot(SearchingRobot, TableStore, Protocol):
    """A robot that searches for contact, and whose controller moves it to the rows of a compensation table."""
