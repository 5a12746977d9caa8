"""What a PC asks of the tables: read from XML, done, and answered."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import final
from xml.sax.saxutils import quoteattr

from sims.krc.eki_fields import Unreadable, child, joints, whole, word
from sims.krc.tables import NoSuchRows, Row, Table, Tables, row_lines, table_sum

MOST_AT_ONCE = 10
"""Rows of a block."""


class WrongSerial(Exception):
    """A table that was made for another controller."""


@final
@dataclass(frozen=True, slots=True)
class Stage:
    """TSTAGE."""

    table_id: str
    serial: str
    size: int
    sum: str


@final
@dataclass(frozen=True, slots=True)
class Take:
    """TBLOCK; `numbers` as the rows themselves say."""

    first: int
    sum: str
    numbers: tuple[int, ...]
    rows: tuple[Row, ...]


@final
@dataclass(frozen=True, slots=True)
class Read:
    """TREAD."""

    first: int
    count: int


@final
@dataclass(frozen=True, slots=True)
class Activate:
    """TACTIVATE."""

    table_id: str
    sum: str


@final
@dataclass(frozen=True, slots=True)
class Rollback:
    """TROLLBACK."""


@final
@dataclass(frozen=True, slots=True)
class Show:
    """TSTATE."""


Request = Stage | Take | Read | Activate | Rollback | Show


def read_request(root: ET.Element, op: str, axes: int) -> Request:
    """The request of a command whose Op is one of TABLE_OPERATIONS. Raises Unreadable."""
    return TABLE_OPERATIONS[op](root, axes)


def _read_stage(root: ET.Element, _: int) -> Stage:
    table = child(root, "Table")
    return Stage(word(table, "Id"), word(table, "Serial"), whole(table, "Rows"), word(table, "Sum"))


def _read_take(root: ET.Element, axes: int) -> Take:
    block, rows = child(root, "Block"), root.findall("R")
    _check_count(block, len(rows))
    return Take(
        whole(block, "First"),
        word(block, "Sum"),
        tuple(whole(row, "N") for row in rows),
        tuple(_read_row(row, axes) for row in rows),
    )


def _read_row(row: ET.Element, axes: int) -> Row:
    return Row(joints(child(row, "Q"), axes), joints(child(row, "C"), axes))


def _read_read(root: ET.Element, _: int) -> Read:
    block = child(root, "Block")
    count = whole(block, "Count")
    _check_count(block, count)
    return Read(whole(block, "First"), count)


def _check_count(block: ET.Element, count: int) -> None:
    if not 1 <= count <= MOST_AT_ONCE:
        raise Unreadable(f"a block has 1 … {MOST_AT_ONCE} rows, not {count}")
    if whole(block, "Count") != count:
        raise Unreadable(f"Block Count is {block.get('Count')}, but there are {count} rows")


def _read_activate(root: ET.Element, _: int) -> Activate:
    table = child(root, "Table")
    return Activate(word(table, "Id"), word(table, "Sum"))


TABLE_OPERATIONS: dict[str, Callable[[ET.Element, int], Request]] = {
    "TSTAGE": _read_stage,
    "TBLOCK": _read_take,
    "TREAD": _read_read,
    "TACTIVATE": _read_activate,
    "TROLLBACK": lambda root, axes: Rollback(),
    "TSTATE": lambda root, axes: Show(),
}


def do(request: Request, tables: Tables, serial: str) -> str:
    """Do it; returns the reply's inner elements. Raises WrongSerial, TableRefused: then nothing has changed."""
    match request:
        case Stage():
            if request.serial != serial:
                raise WrongSerial(f"this controller is {serial}, not {request.serial}")
            tables.stage(request.table_id, request.size, request.sum)
        case Take():
            _check_order(request)
            tables.take(request.first, request.rows, request.sum)
        case Read():
            return _print_rows(request.first, tables.read(request.first, request.count))
        case Activate():
            tables.activate(request.table_id, request.sum)
        case Rollback():
            tables.rollback()
        case Show():
            return _print_state(tables)
    return ""


def _check_order(block: Take) -> None:
    if block.numbers != tuple(range(block.first, block.first + len(block.rows))):
        raise NoSuchRows(f"rows {', '.join(map(str, block.numbers))} do not run on from {block.first}")


def _print_rows(first: int, rows: Sequence[Row]) -> str:
    total = table_sum(row_lines(first, rows))
    printed = [f'<Block First="{first}" Count="{len(rows)}" Sum="{total}"/>']
    for n, row in enumerate(rows, first):
        printed.append(f'<R N="{n}"><Q {_axes(row.nominal)}/><C {_axes(row.compensated)}/></R>')
    return "".join(printed)


def _axes(angles: Sequence[float]) -> str:
    return " ".join(f'A{axis}="{angle:.6f}"' for axis, angle in enumerate(angles, 1))


def _print_state(tables: Tables) -> str:
    staged = tables.staged
    printed = _print_table("Active", tables.active) + _print_table("Previous", tables.previous)
    if staged:
        printed += f'<Staged Id={quoteattr(staged.id)} Rows="{staged.size}" Taken="{len(staged.rows)}"/>'
    return printed


def _print_table(name: str, table: Table | None) -> str:
    if table is None:
        return ""
    return f'<{name} Id={quoteattr(table.id)} Rows="{len(table.rows)}" Sum="{table.sum}"/>'
