"""Compensation tables on a controller: staged, read back, compared, activated at once, rolled back; their errors."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Protocol, final, runtime_checkable

from cellctl.devices._protocols import Device, JointReadings, MovingRobot, SearchingRobot
from cellctl.devices.errors import DeviceLost, DeviceRefused, DeviceUncertain, LimitExceeded


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
    """A robot that goes to the rows of a table, which its controller keeps, or this computer (`HostTables`)."""

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


ASK_WHICH_TABLE = "Connect again and ask which table is active (cellctl table show) before anything relies on one."
"""The cure where it is not known which table is active."""


def refuse_rows(device: str, table: ControllerTable, most: int) -> None:
    """Raise DeviceRefused for a table without rows, or with more than `most`."""
    if not 0 < len(table.rows) <= most:
        raise DeviceRefused(device, f"a table of {len(table.rows)} rows (1 … {most} fit)")


def refuse_corrections(device: str, table: ControllerTable, most_deg: float) -> None:
    """Raise LimitExceeded for a row that corrects a joint by more than `most_deg`, deg."""
    for number, row in enumerate(table.rows, 1):
        refuse_correction(device, f"row {number} of table {table.id[:12]}", row, most_deg)


def refuse_correction(device: str, name: str, row: TableRow, most_deg: float) -> None:
    """The same for one row; name: of it, as the error begins."""
    largest = max(abs(a - b) for a, b in zip(row.compensated, row.nominal, strict=True))
    if not largest <= most_deg:  # a NaN is no correction either
        raise LimitExceeded(device, f"{name} corrects a joint by {largest:.3f}° (at most {most_deg:g}°)")


@contextmanager
def lost_before_activation(device: str, table: ControllerTable) -> Iterator[None]:
    """A DeviceLost says that `table` was not activated."""
    try:
        yield
    except DeviceLost as lost:
        what = f"{lost.what}; table {table.id[:12]} was not activated, the old one is in force"
        raise DeviceLost(device, what, lost.cure) from lost


@contextmanager
def lost_in_activation(device: str, uncertain: str) -> Iterator[None]:
    """A DeviceLost becomes DeviceUncertain; `uncertain`: of what, as `whether …`."""
    try:
        yield
    except DeviceLost as lost:
        raise DeviceUncertain(device, f"{lost.what}; uncertain {uncertain}", ASK_WHICH_TABLE) from lost
