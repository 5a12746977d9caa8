"""The documents of the transfer channel: commands read, replies and states printed."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from enum import IntEnum
from math import isfinite
from typing import final
from xml.sax.saxutils import quoteattr

from sims.krc.motions import Joints

OPERATIONS = frozenset({"HELLO", "PTP", "RSI", "HALT", "RESET"})


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


@final
@dataclass(frozen=True, slots=True)
class Command:
    """A command; `target` (degrees) and `percent` for PTP only."""

    id: str
    op: str
    target: Joints = ()
    percent: float = 0.0


@final
class Unreadable(ValueError):
    """No command; `id` is its Id where that much could be read."""

    def __init__(self, what: str, command_id: str = "") -> None:
        self.id = command_id
        super().__init__(what)


def read_command(document: bytes, axes: int) -> Command:
    """Read a command of a robot with so many axes. Raises Unreadable."""
    try:
        root = ET.fromstring(document)
    except (ET.ParseError, ValueError, LookupError) as error:  # the latter two: an encoding that there is not
        raise Unreadable(f"not XML: {error}") from None
    command_id, op = root.get("Id", ""), root.get("Op", "")
    if root.tag != "Cmd":
        raise Unreadable(f"not a Cmd: {root.tag}", command_id)
    if op not in OPERATIONS:
        raise Unreadable(f"unknown operation '{op}'", command_id)
    if op != "PTP":
        return Command(command_id, op)
    target = tuple(_number(root, "Q", f"A{i + 1}", command_id) for i in range(axes))
    return Command(command_id, op, target, _number(root, "Vel", "P", command_id))


def print_reply(command_id: str, code: Code, text: str, joints: Joints, ident: str = "") -> bytes:
    """`<Rep …>`, `ident` being the Ident element where there is one."""
    head = f'<Rep Id={quoteattr(command_id)} Code="{code.value}" Text={quoteattr(text)}>'
    return f"{head}{ident}{_joints(joints)}</Rep>".encode()


def print_ident(serial: str, model: str, kss: str) -> str:
    """The Ident element of HELLO's reply."""
    return f'<Ident Serial={quoteattr(serial)} Model={quoteattr(model)} KSS={quoteattr(kss)} Version="1"/>'


def print_state(sequence: int, prog: str, message: str, joints: Joints) -> bytes:
    """`<Stat …>`; the mode is always EXT: nobody turns the key."""
    head = f'<Stat Seq="{sequence}" Mode="EXT" Prog="{prog}" Msg={quoteattr(message)}>'
    return f"{head}{_joints(joints)}</Stat>".encode()


def _joints(joints: Joints) -> str:
    return "<Q " + " ".join(f'A{i}="{joint:.4f}"' for i, joint in enumerate(joints, 1)) + "/>"


def _number(root: ET.Element, child: str, attribute: str, command_id: str) -> float:
    found = root.find(child)
    text = found.get(attribute, "") if found is not None else ""
    try:
        value = float(text)
    except ValueError:
        raise Unreadable(f"{child} {attribute} is no number: '{text}'", command_id) from None
    if not isfinite(value):
        raise Unreadable(f"{child} {attribute} is not finite", command_id)
    return value
