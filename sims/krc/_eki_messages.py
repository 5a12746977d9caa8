"""The documents of the transfer channel: commands read, tables changed as they ask, replies and states printed."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import final
from xml.sax.saxutils import quoteattr

from sims.krc import _xml_documents as fields
from sims.krc._tables import BadSize, BadSum, NoSuchRows, Row, Table, TableRefused, Tables, row_lines, table_sum
from sims.krc._xml_documents import Unreadable, child, joints, parse, whole, word
from sims.memory import Memory
from sims.scene.motions import Joints

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


OPERATIONS = frozenset({"HELLO", "PTP", "PTPT", "RSI", "CORRON", "CORROFF", "OWN", "HALT", "RESET", *TABLE_OPERATIONS})

_LARGEST_PERCENT = 1e6
"""Larger is unreadable; what is larger than 100 is refused with a code of its own."""


@final
class Code(IntEnum):
    """What became of a command."""

    DONE = 0
    RSI_ON = 1
    BUSY = 10
    UNREADABLE = 11
    NOT_READY = 12
    OUTSIDE_LIMIT = 20
    BAD_SPEED = 21
    STOPPED = 30
    CONTROLLER_STOP = 31
    WRONG_SERIAL = 40
    BAD_SUM = 41
    NO_SUCH_ROWS = 42
    BAD_SIZE = 43


@final
@dataclass(frozen=True, slots=True)
class Command:
    """A command; `percent` for PTP and PTPT, `target` (degrees) for PTP, `row` for PTPT and OWN, `request` for the
    tables.
    """

    id: str
    op: str
    target: Joints = ()
    percent: float = 0.0
    row: int = 0
    request: Request | None = None


def read_command(document: bytes, axes: int) -> Command:
    """Read a command of a robot with so many axes. Raises Unreadable."""
    try:
        root = parse(document)
    except ValueError as error:
        raise Unreadable(str(error)) from None
    command_id, op = root.get("Id", ""), root.get("Op", "")
    if root.tag != "Cmd":
        raise Unreadable(f"not a Cmd: {root.tag}", command_id)
    if op not in OPERATIONS:
        raise Unreadable(f"unknown operation '{op}'", command_id)
    try:
        return _command(root, command_id, op, axes)
    except Unreadable as error:
        raise Unreadable(str(error), command_id) from None


def _command(root: ET.Element, command_id: str, op: str, axes: int) -> Command:
    if op in TABLE_OPERATIONS:
        return Command(command_id, op, request=read_request(root, op, axes))
    if op == "OWN":
        return Command(command_id, op, row=fields.whole(fields.child(root, "Row"), "N"))
    if op not in {"PTP", "PTPT"}:
        return Command(command_id, op)
    percent = fields.number(fields.child(root, "Vel"), "P", _LARGEST_PERCENT)
    if op == "PTPT":
        return Command(command_id, op, percent=percent, row=fields.whole(fields.child(root, "Row"), "N"))
    return Command(command_id, op, fields.joints(fields.child(root, "Q"), axes), percent)


def print_reply(command_id: str, code: Code, text: str, joints: Joints, inner: str = "") -> bytes:
    """`<Rep …>`, `inner` being the elements before the joints where there are any."""
    head = f'<Rep Id={quoteattr(command_id)} Code="{code.value}" Text={quoteattr(text)}>'
    return f"{head}{inner}{_joints(joints)}</Rep>".encode()


def print_ident(serial: str, model: str, kss: str, rsi_on: tuple[str, str] | None) -> str:
    """The Ident element of HELLO's reply; `rsi_on`: mode and cycle of the program's RSI_ON, None: not named."""
    named = f' Correction="{rsi_on[0]}" Cycle="{rsi_on[1]}"' if rsi_on else ""
    return f'<Ident Serial={quoteattr(serial)} Model={quoteattr(model)} KSS={quoteattr(kss)}{named} Version="1"/>'


def print_state(sequence: int, mode: str, prog: str, message: str, joints: Joints) -> bytes:
    """`<Stat …>`."""
    head = f'<Stat Seq="{sequence}" Mode="{mode}" Prog="{prog}" Msg={quoteattr(message)}>'
    return f"{head}{_joints(joints)}</Stat>".encode()


def _joints(joints: Joints) -> str:
    return "<Q " + " ".join(f'A{i}="{joint:.4f}"' for i, joint in enumerate(joints, 1)) + "/>"


_CODES = {BadSum: Code.BAD_SUM, BadSize: Code.BAD_SIZE}


@final
class TableDesk:
    """The tables of the controller with this serial. What is active is remembered before it is answered."""

    def __init__(self, tables: Tables, serial: str, memory: Memory) -> None:
        self._tables = tables
        self._memory = memory
        self._serial = serial

    def ask(self, request: Request) -> tuple[Code, str, str]:
        """Execute the request or refuse it; returns code, text, the reply's inner elements."""
        try:
            inner = do(request, self._tables, self._serial)
        except WrongSerial as error:
            return Code.WRONG_SERIAL, str(error), ""
        except TableRefused as error:
            return _CODES.get(type(error), Code.NO_SUCH_ROWS), str(error), ""
        if isinstance(request, Activate | Rollback):
            self._memory.save()
        return Code.DONE, "", inner

    def target(self, row: int) -> Joints | None:
        """Where PTPT goes, degrees; None where the active table has no such row."""
        return self._tables.target(row)

    def forget_staged(self) -> None:
        """The controller restarts."""
        self._tables.forget_staged()
