"""Compensation tables on a controller: staged, read back, compared, activated at once, rolled back."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, final, runtime_checkable

from cellctl.devices.protocols import Device, JointReadings, SearchingRobot


@final
@dataclass(frozen=True, slots=True)
class TableRow:
    """A target's joints, degrees: as the nominal model gives them, and compensated."""

    nominal: JointReadings
    compensated: JointReadings


@final
@dataclass(frozen=True, slots=True)
class ControllerTable:
    """A table as a controller takes it: `id` is the table file's, `serial` the controller's that it was made for."""

    id: str
    serial: str
    rows: tuple[TableRow, ...]


@final
@dataclass(frozen=True, slots=True)
class TableInfo:
    """A table that a controller has: its id, how many of its rows are there, and the check sum over them.

    The check sum is empty for a staged table: not all of it need have arrived.
    """

    id: str
    rows: int
    checksum: str


@final
@dataclass(frozen=True, slots=True)
class TableState:
    """What tables a controller has: in force, in force before, and how many rows of a staged one have arrived."""

    active: TableInfo | None
    previous: TableInfo | None
    staged: TableInfo | None


@runtime_checkable
class TableStore(Device, Protocol):
    """A controller that keeps compensation tables and moves to their rows."""

    async def push_table(self, table: ControllerTable) -> TableState:
        """Stage in blocks, read every row back, compare, activate at once; the old table is in force until then.

        Raises DeviceRefused (another serial or check sum, too many rows), DeviceFault (what was read back differs),
        DeviceLost (before the activation: the old table is in force), DeviceUncertain (lost at the activation itself:
        either table may be in force, whole, until `table_state` has been asked).
        """

    async def table_state(self) -> TableState:
        """What tables there are. Raises DeviceRefused, DeviceLost."""

    async def read_table(self) -> ControllerTable | None:
        """The active table, row by row as the controller holds it; None where none is.

        Raises DeviceRefused (a table staged and never activated is in the way), DeviceFault (its rows do not fit its
        check sum), DeviceLost.
        """

    async def rollback_table(self) -> TableState:
        """Put the table before into force again.

        Raises DeviceRefused where there is none to roll back, DeviceLost, DeviceUncertain (lost once it was asked for).
        """

    async def move_to_row(self, row: int, speed_percent: float) -> JointReadings:
        """Point to point to the compensated joints of `row` (from 1) of the active table; raises as `move` does."""


@runtime_checkable
class CompensatedRobot(SearchingRobot, TableStore, Protocol):
    """A robot that searches for contact, and whose controller moves it to the rows of a compensation table."""
