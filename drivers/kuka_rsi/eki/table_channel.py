"""Compensation tables over the transfer channel: staged, read back, compared, activated; never partially."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import zip_longest
from typing import final

from cellctl.devices import ControllerTable, DeviceFault, DeviceRefused, TableInfo, TableState
from cellctl.devices.tables import LOOK, lost_before_activation, lost_in_activation, refuse_rows
from drivers.kuka_rsi.eki.channel import EkiChannel, Pending
from drivers.kuka_rsi.eki.documents import Reply
from drivers.kuka_rsi.eki.refusals import refusal
from drivers.kuka_rsi.eki.table_rows import (
    MOST_ROWS,
    WrittenRow,
    activation,
    asked_for,
    block,
    blocks,
    checksum,
    read_rows,
    read_state,
    staging,
    written_rows,
)
from drivers.seen_through import see_through


@final
class TableChannel:
    """The tables of the controller behind `eki`, whose serial is `serial`; methods as in TableStore."""

    def __init__(self, device: str, eki: EkiChannel, serial: str) -> None:
        self._device = device
        self._eki = eki
        self._serial = serial

    async def push(self, table: ControllerTable) -> TableState:
        """Stage, read back, compare, activate, look; see `TableStore.push_table`."""
        refuse_rows(self._device, table, MOST_ROWS)
        rows = written_rows(table)
        with lost_before_activation(self._device, table):
            await self._stage(table, rows)
            await self._compare(table, rows)
            pending = await self._eki.send("TACTIVATE", activation(table, rows))
        return await see_through(self._activated(pending, TableInfo(table.id, len(rows), checksum(rows))))

    async def state(self) -> TableState:
        """The tables that the controller reports."""
        reply = await self._ask("TSTATE", "", "table state")
        with self._understood("TSTATE"):
            return read_state(reply.document)

    async def read(self) -> ControllerTable | None:
        """The active table as stored on the controller, its check sum verified; see `TableStore.read_table`."""
        state = await self.state()
        if state.staged:
            what = f"table {_short(state.staged.id)} was staged and never activated; it is read in place of the active"
            raise DeviceRefused(self._device, what, "Push it to its end, or restart the controller: then it is gone.")
        if state.active is None:
            return None
        rows = [row for numbers in blocks(state.active.rows) for row in await self._read(numbers)]
        if found := _differs(state.active, TableInfo(state.active.id, len(rows), checksum(rows))):
            raise DeviceFault(self._device, f"the active table is not what its controller says: {found}")
        with self._understood("TREAD"):
            return ControllerTable(state.active.id, self._serial, tuple(row.numbers() for row in rows))

    async def rollback(self) -> TableState:
        """Swap active and previous, once; see `TableStore.rollback_table`."""
        return await see_through(self._rolled_back(await self._eki.send("TROLLBACK")))

    # internal

    async def _stage(self, table: ControllerTable, rows: Sequence[WrittenRow]) -> None:
        await self._ask("TSTAGE", staging(table, rows), "stage a table")
        for numbers in blocks(len(rows)):
            await self._ask("TBLOCK", block(numbers, rows), f"stage rows {numbers.start} … {numbers.stop - 1}")

    async def _compare(self, table: ControllerTable, rows: Sequence[WrittenRow]) -> None:
        """Compare every character read back with the one sent."""
        back = [row for numbers in blocks(len(rows)) for row in await self._read(numbers)]
        for sent, found in zip_longest(rows, back):
            if sent != found:
                raise DeviceFault(
                    self._device,
                    f"table {_short(table.id)} read back differs, {_told(sent)} came back as {_told(found)}; "
                    "it was not activated, the old one is in force",
                    "Push again. Where it stays: another program writes to the controller, or its program is not ours.",
                )

    async def _read(self, numbers: range) -> list[WrittenRow]:
        reply = await self._ask("TREAD", asked_for(numbers), f"read rows {numbers.start} … {numbers.stop - 1}")
        with self._understood("TREAD"):
            return read_rows(reply.document)

    async def _activated(self, pending: Pending, asked: TableInfo) -> TableState:
        with lost_in_activation(self._device, f"whether table {_short(asked.id)} or the old one is in force"):
            reply = await self._eki.answer_to(pending, "TACTIVATE")
            self._check(reply, "activate the table")
            state = await self.state()
        if state.active is None or (found := _differs(asked, state.active)):
            what = found if state.active else "no table is active"
            raise DeviceFault(self._device, f"table {_short(asked.id)} was activated, and yet {what}", LOOK)
        return state

    async def _rolled_back(self, pending: Pending) -> TableState:
        with lost_in_activation(self._device, "whether the table was rolled back"):
            reply = await self._eki.answer_to(pending, "TROLLBACK")
            self._check(reply, "roll back")
            return await self.state()

    async def _ask(self, operation: str, content: str, doing: str) -> Reply:
        reply = await self._eki.ask(operation, content)
        self._check(reply, doing)
        return reply

    def _check(self, reply: Reply, doing: str) -> None:
        if reply.code:
            raise refusal(self._device, reply, doing)

    @contextmanager
    def _understood(self, operation: str) -> Iterator[None]:
        try:
            yield
        except ValueError as error:
            raise DeviceFault(self._device, f"the answer to {operation} makes no sense: {error}") from None


def _short(table_id: str) -> str:
    return table_id[:12]


def _told(row: WrittenRow | None) -> str:
    return f"'{row.line.strip()}'" if row else "nothing"


def _differs(expected: TableInfo, found: TableInfo) -> str:
    """The difference as text; empty if there is none."""
    pairs = {"id": (expected.id, found.id), "rows": (expected.rows, found.rows)}
    pairs["check sum"] = (expected.checksum, found.checksum)
    return ", ".join(f"{name} {b} instead of {a}" for name, (a, b) in pairs.items() if a != b)
