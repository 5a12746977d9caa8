"""Compensation tables that this computer holds, for a controller that cannot keep any.

The robot goes to a row by an ordinary motion to its compensated joints. The file is bound to the controller's serial
and to its calibration: whatever the controller states of the arm that it computes with (a hash of its kinematics, a
date). A table was made against those kinematics: after an exchange of the arm, or a new calibration, it is not used.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Protocol, final

from cellctl.devices._protocols import JointReadings
from cellctl.devices.errors import DeviceFault, DeviceRefused
from cellctl.devices.tables import (
    ControllerTable,
    TableInfo,
    TableRow,
    TableState,
    refuse_correction,
    refuse_corrections,
    refuse_rows,
)
from cellctl.files import canonical_json, sha256_of, write_atomically

MOST_ROWS = 10_000
"""A larger table is a mistake: a controller's own holds some thousands."""

_FORMAT = "cellctl host table 1"


@final
@dataclass(frozen=True, slots=True)
class HostTables:
    """The active table and the one before it, in `file`, for the robot `device`.

    serial, calibration: as the controller states them now. correction_deg: largest correction of a joint that is
    accepted and driven to: the lowest layer's own limit.
    """

    device: str
    file: Path
    serial: str
    calibration: str
    correction_deg: float

    def state(self) -> TableState:
        """What is kept. Raises DeviceRefused for another serial or calibration, DeviceFault for a damaged file."""
        active, previous = (_info(table) if table else None for table in self._kept())
        return TableState(active, previous, None)

    def active(self) -> ControllerTable | None:
        """The active table; None without one. Raises as `state`."""
        return self._kept()[0]

    def push(self, table: ControllerTable) -> TableState:
        """Keep `table` as the active one, the active one as the one before it.

        Tables of another calibration are dropped: they cannot be activated again. Raises DeviceRefused (another serial,
        too many rows, not written), LimitExceeded; the table before stays active then.
        """
        refuse_rows(self.device, table, MOST_ROWS)
        if table.serial != self.serial:
            raise DeviceRefused(self.device, f"table {table.id[:12]} is for controller '{table.serial}'")
        refuse_corrections(self.device, table, self.correction_deg)
        try:
            before = self._kept()[0]
        except (DeviceRefused, DeviceFault):
            before = None
        self._write(table, before)
        return self.state()

    def roll_back(self) -> TableState:
        """Activate the table before. Raises DeviceRefused if there is no table, or it was not written."""
        active, previous = self._kept()
        if active is None:
            raise DeviceRefused(self.device, "there is no table to roll back")
        self._write(previous, None)
        return self.state()

    def compensated(self, row: int) -> JointReadings:
        """The compensated joints of `row` (from 1) of the active table. Raises DeviceRefused, LimitExceeded."""
        table = self.active()
        if table is None or not 1 <= row <= len(table.rows):
            rows = f"rows 1 … {len(table.rows)}" if table else "no table"
            raise DeviceRefused(self.device, f"there is no row {row}: this computer holds {rows} for it")
        found = table.rows[row - 1]
        refuse_correction(self.device, f"row {row} of table {table.id[:12]}", found, self.correction_deg)
        return found.compensated

    def _kept(self) -> tuple[ControllerTable | None, ControllerTable | None]:
        if not self.file.exists():
            return None, None
        try:
            kept = json.loads(self.file.read_text(encoding="utf-8"))
            content, checksum = kept["content"], kept["sha256"]
            if content["format"] != _FORMAT or sha256_of(content) != checksum:
                raise ValueError("its check sum is another")
            tables = _table(content["active"]), _table(content["previous"])
            serial, calibration = str(content["serial"]), str(content["calibration"])
        except (OSError, ValueError, TypeError, KeyError) as error:
            cure = "push the table anew; the damaged file is replaced then"
            raise DeviceFault(self.device, f"{self.file} cannot be read as a table: {error}", cure) from error
        for word, stated, now in (("serial", serial, self.serial), ("calibration", calibration, self.calibration)):
            if stated != now:
                what = f"the table in {self.file} is for {word} '{stated}', the controller has '{now}'"
                raise DeviceRefused(self.device, what, "identify the robot anew and push its table; nothing was moved")
        return tables

    def _write(self, active: ControllerTable | None, previous: ControllerTable | None) -> None:
        content = {
            "format": _FORMAT,
            "serial": self.serial,
            "calibration": self.calibration,
            "active": asdict(active) if active else None,
            "previous": asdict(previous) if previous else None,
        }
        try:
            self.file.parent.mkdir(parents=True, exist_ok=True)
            write_atomically(self.file, canonical_json({"content": content, "sha256": sha256_of(content)}))
        except OSError as error:
            what = f"{self.file} cannot be written ({error.strerror}): the tables are as before"
            raise DeviceRefused(self.device, what, "free the disk, or let this user write there") from error


class _Mover(Protocol):
    """A robot driver that has `HostTables`."""

    host_tables: HostTables

    async def move(self, target: JointReadings, speed_percent: float) -> JointReadings:
        """As `MovingRobot.move`."""


class HostTableStore:
    """The methods of `TableStore` for a driver that has `host_tables` and `move`; it derives from this."""

    async def push_table(self: _Mover, table: ControllerTable) -> TableState:
        """As `HostTables.push`: read back by the check sum of the file."""
        return self.host_tables.push(table)

    async def table_state(self: _Mover) -> TableState:
        """As `HostTables.state`."""
        return self.host_tables.state()

    async def read_table(self: _Mover) -> ControllerTable | None:
        """As `HostTables.active`."""
        return self.host_tables.active()

    async def rollback_table(self: _Mover) -> TableState:
        """As `HostTables.roll_back`."""
        return self.host_tables.roll_back()

    async def move_to_row(self: _Mover, row: int, speed_percent: float) -> JointReadings:
        """To the compensated joints of `row` (from 1). Raises as `HostTables.compensated`, and as `move` does."""
        return await self.move(self.host_tables.compensated(row), speed_percent)


def _info(table: ControllerTable) -> TableInfo:
    return TableInfo(table.id, len(table.rows), sha256_of(asdict(table)))


def _table(kept: Any) -> ControllerTable | None:
    if kept is None:
        return None
    rows = (TableRow(_joints(row["nominal"]), _joints(row["compensated"])) for row in kept["rows"])
    return ControllerTable(str(kept["id"]), str(kept["serial"]), tuple(rows))


def _joints(values: Any) -> JointReadings:
    return tuple(map(float, values))
