"""Compensation tables in the controller's variables: staged, read back, compared, activated by one variable."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self, final

from cellctl.devices import (
    ControllerTable,
    DeviceFault,
    DeviceRefused,
    TableInfo,
    TableRow,
    TableState,
    lost_before_activation,
    lost_in_activation,
    refuse_rows,
)
from drivers.kuka_varproxy.variables import (
    AXES,
    BANK_KIND,
    BANKS,
    MOST_ROWS,
    ROW_KIND,
    Variables,
    bank,
    plain_text,
    row,
    structure,
    whole,
)
from drivers.seen_through import see_through

_MILLIONTHS = 1_000_000
_NAMES = tuple(f"{letter}{axis}" for letter in "NC" for axis in range(1, AXES + 1))

Numbers = tuple[int, ...]
"""A row: nominal A1 … A6, compensated A1 … A6, in millionths of a degree."""


@final
@dataclass(frozen=True, slots=True)
class Roles:
    """The banks of the active, the previous and the staged table; 0: none."""

    active: int
    previous: int
    staged: int

    @classmethod
    def of(cls, number: int) -> Self:
        """From KV_ROLES: hundreds, tens, ones. Raises ValueError if it names a bank twice, or one that is not."""
        roles = cls(number // 100, number // 10 % 10, number % 10)
        used = [one for one in (roles.active, roles.previous, roles.staged) if one]
        if not 0 <= number < 1000 or len(set(used)) != len(used) or any(one > BANKS for one in used):
            raise ValueError(f"{number} are no roles of {BANKS} banks")
        return roles

    @property
    def number(self) -> int:
        """As KV_ROLES has it."""
        return 100 * self.active + 10 * self.previous + self.staged

    @property
    def free(self) -> int:
        """A bank that is neither active nor previous."""
        return next(one for one in range(1, BANKS + 1) if one not in (self.active, self.previous))


@final
class TableMemory:
    """The tables of the controller with this serial; methods as in TableStore."""

    def __init__(self, device: str, variables: Variables, serial: str) -> None:
        self._device = device
        self._variables = variables
        self._serial = serial

    async def push(self, table: ControllerTable) -> TableState:
        """Stage, read every row back, compare, activate; see `TableStore.push_table`."""
        if table.serial != self._serial:
            what = f"the table was made for controller {table.serial}, this is {self._serial}"
            cure = "A table holds for the one robot that it was identified on: push the one made for this controller."
            raise DeviceRefused(self._device, what, cure)
        refuse_rows(self._device, table, MOST_ROWS)
        rows = [_numbers(one) for one in table.rows]
        with lost_before_activation(self._device, table):
            staged = await self._stage(table.id, rows)
        return await see_through(self._give_roles(staged, f"whether table {table.id[:12]} or the old one is in force"))

    async def state(self) -> TableState:
        """The tables that the controller has."""
        roles = await self._roles()
        return TableState(
            await self._info(roles.active), await self._info(roles.previous), await self._info(roles.staged, taken=True)
        )

    async def read(self) -> ControllerTable | None:
        """The active table, its check sum verified; see `TableStore.read_table`."""
        active = (await self._roles()).active
        info = await self._info(active)
        if info is None:
            return None
        rows = [await self._row(active, number) for number in range(1, info.rows + 1)]
        if (found := checksum(rows)) != info.checksum:
            what = f"the active table has check sum {found}, and its head says {info.checksum}"
            raise DeviceFault(self._device, what, "Roll back, or push the table again.")
        return ControllerTable(info.id, self._serial, tuple(map(_table_row, rows)))

    async def rollback(self) -> TableState:
        """Active and previous change places; see `TableStore.rollback_table`."""
        roles = await self._roles()
        if not roles.active and not roles.previous:
            raise DeviceRefused(self._device, "there is no table to roll back")
        swapped = Roles(roles.previous, roles.active, roles.staged)
        return await see_through(self._give_roles(swapped, "whether the table was rolled back"))

    async def active_row(self, number: int) -> TableRow:
        """A row of the active table, from 1. Raises DeviceRefused if there is none."""
        active = (await self._roles()).active
        info = await self._info(active)
        if info is None or not 1 <= number <= info.rows:
            raise DeviceRefused(self._device, f"the active table has no row {number}")
        return _table_row(await self._row(active, number))

    # internal

    async def _stage(self, table_id: str, rows: Sequence[Numbers]) -> Roles:
        """Write and compare all of it; the roles that make it the active one. An active table of this id stays so."""
        roles, info = await self._roles(), TableInfo(table_id, len(rows), checksum(rows))
        if roles.active and await self._info(roles.active) == info:
            await self._compare(roles.active, rows)
            return Roles(roles.active, roles.previous, 0)
        place = roles.free
        await self._variables.write_verified("KV_ROLES", str(Roles(roles.active, roles.previous, 0).number))
        await self._variables.write_verified(bank(place), _head(info, taken=0))
        await self._variables.write_verified("KV_ROLES", str(Roles(roles.active, roles.previous, place).number))
        for number, numbers in enumerate(rows, 1):
            await self._variables.write(row(place, number), _row_text(numbers))
        await self._compare(place, rows)
        await self._variables.write_verified(bank(place), _head(info, taken=len(rows)))
        return Roles(place, roles.active, 0)

    async def _compare(self, place: int, rows: Sequence[Numbers]) -> None:
        """Read every row of a bank back. Raises DeviceFault at the first that differs."""
        for number, sent in enumerate(rows, 1):
            found = await self._row(place, number)
            if found != sent:
                raise DeviceFault(
                    self._device,
                    f"row {number} read back differs, {sent} came back as {found}; "
                    "it was not activated, the old one is in force",
                    "Push again. Where it stays: another program writes to the controller's variables.",
                )

    async def _give_roles(self, roles: Roles, uncertain: str) -> TableState:
        """Write KV_ROLES, the only step that changes which table is in force, and look."""
        with lost_in_activation(self._device, uncertain):
            await self._variables.write_verified("KV_ROLES", str(roles.number))
            return await self.state()

    async def _roles(self) -> Roles:
        number = await self._variables.whole("KV_ROLES")
        try:
            return Roles.of(number)
        except ValueError as error:
            cure = "Another program wrote to it. Look which bank holds which table, and set it at the pendant."
            raise DeviceFault(self._device, f"KV_ROLES makes no sense: {error}", cure) from None

    async def _info(self, place: int, *, taken: bool = False) -> TableInfo | None:
        if not place:
            return None
        head = await self._variables.fields(bank(place))
        try:
            rows = whole(head["TAKEN" if taken else "ROWS"])
            return TableInfo(plain_text(head["ID[]"]), rows, "" if taken else plain_text(head["SUM[]"]))
        except (KeyError, ValueError) as error:
            raise DeviceFault(self._device, f"the head of bank {place} makes no sense: {error}") from None

    async def _row(self, place: int, number: int) -> Numbers:
        values = await self._variables.fields(row(place, number))
        try:
            return tuple(whole(values[name]) for name in _NAMES)
        except (KeyError, ValueError) as error:
            raise DeviceFault(self._device, f"row {number} of bank {place} makes no sense: {error}") from None


def checksum(rows: Sequence[Numbers]) -> str:
    """CRC-32 over a line per row, `N;A1;…;A6;A1;…;A6`, six decimals: eight upper-case hexadecimal digits."""
    lines = (";".join([str(n), *(f"{x / _MILLIONTHS:.6f}" for x in numbers)]) for n, numbers in enumerate(rows, 1))
    return f"{zlib.crc32(''.join(line + chr(10) for line in lines).encode()):08X}"


def _numbers(one: TableRow) -> Numbers:
    return tuple(round(angle * _MILLIONTHS) for angle in (*one.nominal, *one.compensated))


def _table_row(numbers: Numbers) -> TableRow:
    angles = tuple(number / _MILLIONTHS for number in numbers)
    return TableRow(angles[:AXES], angles[AXES:])


def _row_text(numbers: Numbers) -> str:
    return structure(ROW_KIND, dict(zip(_NAMES, numbers, strict=True)))


def _head(info: TableInfo, *, taken: int) -> str:
    return structure(BANK_KIND, {"ID[]": info.id, "SUM[]": info.checksum, "ROWS": info.rows, "TAKEN": taken})
