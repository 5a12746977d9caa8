"""The documents of the transfer channel: commands read, replies and states printed."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from enum import IntEnum
from typing import final
from xml.sax.saxutils import quoteattr

from sims.krc import eki_fields as fields
from sims.krc.eki_fields import Unreadable
from sims.krc.table_requests import TABLE_OPERATIONS, Request, read_request
from sims.krc.xml_documents import parse
from sims.scene.motions import Joints

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


def print_state(sequence: int, prog: str, message: str, joints: Joints) -> bytes:
    """`<Stat …>`; the mode is always EXT."""
    head = f'<Stat Seq="{sequence}" Mode="EXT" Prog="{prog}" Msg={quoteattr(message)}>'
    return f"{head}{_joints(joints)}</Stat>".encode()


def _joints(joints: Joints) -> str:
    return "<Q " + " ".join(f'A{i}="{joint:.4f}"' for i, joint in enumerate(joints, 1)) + "/>"
