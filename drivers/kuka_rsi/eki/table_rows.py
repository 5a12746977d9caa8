"""Compensation tables on the transfer channel (docs/reference/eki-channel.md): text, blocks, check sums."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self, final
from xml.etree import ElementTree
from xml.sax.saxutils import quoteattr

from cellctl.devices import ControllerTable, TableInfo, TableRow, TableState
from drivers.kuka_rsi.axes import AXIS_NAMES

BLOCK_ROWS = 2
"""Rows per request; the channel allows ten. The controller computes their sums in KRL, some 3500
statements a row, and the time limit of its answer is 10 s."""

MOST_ROWS = 500


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
    """Row numbers from 1 to `count` in blocks: `[range(1, 11), range(11, 13)]`."""
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
