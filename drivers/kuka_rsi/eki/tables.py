"""Compensation tables over the transfer channel: text, blocks, check sums; staged, read back, compared, activated."""

from __future__ import annotations

import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import zip_longest
from typing import Self, final
from xml.etree import ElementTree
from xml.sax.saxutils import quoteattr

from cellctl.devices import (
    ASK_WHICH_TABLE,
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
from drivers.kuka_rsi import AXIS_NAMES
from drivers.kuka_rsi.eki.channel import EkiChannel, Pending, Reply, refusal
from drivers.seen_through import see_through

BLOCK_ROWS = 2
"""Rows per request; the channel allows ten. The controller computes their sums in KRL, some 3500
statements a row, and the time limit of its answer is 10 s."""

MOST_ROWS = 500
"""As many as `cellctl.dat` reserves: CC_TAB[3,500,12]."""


@final
@dataclass(frozen=True, slots=True)
class WrittenRow:
    """A row as text: its number from 1, and the two joint sets in wire format."""

    number: str
    nominal: tuple[str, ...]
    compensated: tuple[str, ...]

    @classmethod
    def of(cls, number: int, row: TableRow) -> Self:
        """Six decimals; a zero has no sign, since a controller's REAL might lose it."""
        return cls(str(number), _written(row.nominal), _written(row.compensated))

    @classmethod
    def read(cls, element: ElementTree.Element) -> Self:
        """`<R>` as received. Raises ValueError if an axis or the number is missing."""
        return cls(_attribute(element, "N"), _axes(element, "Q"), _axes(element, "C"))

    @property
    def line(self) -> str:
        """The line over which check sums run."""
        return ";".join((self.number, *self.nominal, *self.compensated)) + "\n"

    @property
    def element(self) -> str:
        """`<R>` to send."""
        return f'<R N="{self.number}">{_joints("Q", self.nominal)}{_joints("C", self.compensated)}</R>'

    def numbers(self) -> TableRow:
        """The row in degrees. Raises ValueError if a text is not a number."""
        return TableRow(tuple(map(float, self.nominal)), tuple(map(float, self.compensated)))


def written_rows(table: ControllerTable) -> list[WrittenRow]:
    """The table's rows to send."""
    return [WrittenRow.of(number, row) for number, row in enumerate(table.rows, 1)]


def read_rows(reply: ElementTree.Element) -> list[WrittenRow]:
    """The rows in a reply to TREAD. Raises ValueError."""
    return [WrittenRow.read(element) for element in reply.findall("R")]


def checksum(rows: Sequence[WrittenRow]) -> str:
    """CRC-32 of the rows' lines: eight upper-case hexadecimal digits."""
    return f"{zlib.crc32(''.join(row.line for row in rows).encode()):08X}"


def blocks(count: int) -> list[range]:
    """Row numbers from 1 to `count` in blocks of `BLOCK_ROWS`: `[range(1, 3), range(3, 4)]` of three."""
    return [range(first, min(first + BLOCK_ROWS, count + 1)) for first in range(1, count + 1, BLOCK_ROWS)]


def staging(table: ControllerTable, rows: Sequence[WrittenRow]) -> str:
    """Content of TSTAGE."""
    names = f"Id={quoteattr(table.id)} Serial={quoteattr(table.serial)}"
    return f'<Table {names} Rows="{len(rows)}" Sum="{checksum(rows)}"/>'


def block(numbers: range, rows: Sequence[WrittenRow]) -> str:
    """Content of TBLOCK: those of `rows`, a whole table's, that have the block's numbers."""
    part = rows[numbers.start - 1 : numbers.stop - 1]
    head = f'<Block First="{numbers.start}" Count="{len(numbers)}" Sum="{checksum(part)}"/>'
    return head + "".join(row.element for row in part)


def asked_for(numbers: range) -> str:
    """Content of TREAD."""
    return f'<Block First="{numbers.start}" Count="{len(numbers)}"/>'


def activation(table: ControllerTable, rows: Sequence[WrittenRow]) -> str:
    """Content of TACTIVATE."""
    return f'<Table Id={quoteattr(table.id)} Sum="{checksum(rows)}"/>'


def to_row(row: int, speed_percent: float) -> str:
    """Content of PTPT: speed in percent of each axis' maximum, row from 1."""
    return f'<Vel P="{speed_percent:.4f}"/><Row N="{row}"/>'


def read_state(reply: ElementTree.Element) -> TableState:
    """The tables that a reply to TSTATE names. Raises ValueError."""
    return TableState(
        active=_info(reply.find("Active"), "Rows", "Sum"),
        previous=_info(reply.find("Previous"), "Rows", "Sum"),
        staged=_info(reply.find("Staged"), "Taken", None),
    )


def _info(element: ElementTree.Element | None, rows: str, total: str | None) -> TableInfo | None:
    if element is None:
        return None
    count = int(_attribute(element, rows))
    return TableInfo(_attribute(element, "Id"), count, _attribute(element, total) if total else "")


def _written(joints: Sequence[float]) -> tuple[str, ...]:
    return tuple(f"{value:z.6f}" for value in joints)


def _joints(tag: str, texts: Sequence[str]) -> str:
    return f"<{tag} " + " ".join(f'{name}="{text}"' for name, text in zip(AXIS_NAMES, texts, strict=True)) + "/>"


def _axes(element: ElementTree.Element, tag: str) -> tuple[str, ...]:
    joints = element.find(tag)
    if joints is None:
        raise ValueError(f"a row without <{tag}>")
    return tuple(_attribute(joints, name) for name in AXIS_NAMES)


def _attribute(element: ElementTree.Element, name: str) -> str:
    text = element.get(name)
    if text is None:
        raise ValueError(f"<{element.tag}> lacks {name}")
    return text


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
            raise DeviceFault(self._device, f"table {_short(asked.id)} was activated, and yet {what}", ASK_WHICH_TABLE)
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
