"""The controller's variables, the generated program's among them, their values as text; and its files (C3 Bridge).

Source: C3 Bridge Interface Protocol 1.5, section 3.9; where its text and its public server disagree (length of the name
in message 30) this follows the server.
"""

from __future__ import annotations

import math
import re
import struct
from collections.abc import Callable, Mapping
from typing import TypeVar, final

from cellctl.devices import DeviceFault, DeviceRefused, JointReadings
from drivers.kuka_varproxy.line import Answer, Kind, ProxyLine, text_field, wide_field

PROGRAM = "CELLCTL_KVP"
VERSION = 1

FLAG_STOP = 413
TIMER = 20
INTERRUPT_STOP, INTERRUPT_SILENCE = 22, 23
"""Free on the controller: a flag, a timer and two interrupts."""

STOP = f"$FLAG[{FLAG_STOP}]"
SILENCE = f"$TIMER[{TIMER}]"
SILENCE_STOPPED = f"$TIMER_STOP[{TIMER}]"

SILENCE_MS = 1500
"""A move stops when this computer has not set the timer again for so long."""

MOST_ROWS = 500
BANKS = 3

JOB, JOB_KIND = "KV_JOB", "KV_JOB_T"
BANK_KIND, ROW_KIND = "KV_BANK_T", "KV_ROW_T"

AXES = 6

_FIELD = re.compile(r'\s*(\w+(?:\[\])?)\s+("[^"]*"|[^\s,]+)\s*(?:,|$)')

_CURE = "Is the generated program of this cell loaded (cellctl krl), and does its variable belong to this KSS?"

Value = TypeVar("Value")

CHUNK = 16_384
"""Bytes of a file per message."""

_BEGIN, _DATA, _END = 1, 2, 4
_OVERWRITE = 64
_NONE = 0
_CODES = {0: "general error", 2: "access denied", 3: "wrong argument", 7: "not implemented", 9: "protocol error"}
_SIZE = struct.Struct(">I")
_CHUNK_HEAD = struct.Struct(">BII")


def bank(number: int) -> str:
    """The head of a bank: id, check sum, number of rows."""
    return f"KV_BANK[{number}]"


def row(bank_number: int, number: int) -> str:
    """A row of a bank, from 1."""
    return f"KV_TAB[{bank_number},{number}]"


def whole(text: str) -> int:
    """`"17"` → 17. Raises ValueError."""
    if not re.fullmatch(r"\s*[-+]?\d{1,10}\s*", text, re.ASCII):
        raise ValueError(f"'{text}' is no whole number")
    return int(text)


def number(text: str) -> float:
    """`"-185.0"` → -185.0. Raises ValueError."""
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"'{text}' is no number")
    return value


def truth(text: str) -> bool:
    """`"TRUE"` → True. Raises ValueError."""
    known = {"TRUE": True, "FALSE": False}
    if text.strip().upper() not in known:
        raise ValueError(f"'{text}' is neither TRUE nor FALSE")
    return known[text.strip().upper()]


def plain_text(text: str) -> str:
    """`'"KR5"'` → `KR5`: a text without its quotation marks; a number or an enumeration as it is."""
    return text.strip().strip('"').strip("\0 ")


def fields(text: str) -> dict[str, str]:
    """`"{AXIS: A1 0.0, A2 -90.0}"` → `{"A1": "0.0", "A2": "-90.0"}`; texts keep their marks. Raises ValueError."""
    found = re.fullmatch(r"\s*\{\s*(?:\w+\s*:)?(.*)\}\s*", text, re.DOTALL)
    if not found:
        raise ValueError(f"'{text[:60]}' is no structure")
    rest, at, values = found[1], 0, {}
    while rest[at:].strip():
        field = _FIELD.match(rest, at)
        if not field:
            raise ValueError(f"'{rest[at:][:40]}' is no field of a structure")
        values[field[1].upper()] = field[2]
        at = field.end()
    return values


def structure(kind: str, values: Mapping[str, int | str]) -> str:
    """`{KIND: A1 5, ID[] "abc"}`. Raises ValueError for a text with a quotation mark."""
    return "{" + f"{kind}: " + ", ".join(f"{name} {_written(value)}" for name, value in values.items()) + "}"


def same(written: str, read: str) -> bool:
    """Whether the value read back is the one written, however the controller prints spaces, case and field order."""
    if written.startswith("{"):
        return {name: plain_text(value) for name, value in fields(written).items()} == {
            name: plain_text(value) for name, value in fields(read).items()
        }
    return plain_text(written) == plain_text(read)


def joints(text: str) -> JointReadings:
    """A1 … A6 of an AXIS or E6AXIS, degrees. Raises ValueError."""
    values = fields(text)
    try:
        return tuple(number(values[f"A{axis}"]) for axis in range(1, AXES + 1))
    except KeyError as missing:
        raise ValueError(f"'{text[:60]}' lacks {missing.args[0]}") from None


def _written(value: int | str) -> str:
    if isinstance(value, int):
        return str(value)
    if '"' in value:
        raise ValueError(f"'{value}' has a quotation mark")
    return f'"{value}"'


@final
class Variables:
    """The variables behind a line. A value is text as KRL writes it: `"17"`, `"TRUE"`, `"#EX"`, `"{AXIS: A1 0.0, …}"`.

    Every method raises DeviceRefused (no such variable, or protected), DeviceFault (a value that makes no sense) and
    DeviceLost.
    """

    def __init__(self, device: str, line: ProxyLine) -> None:
        self._device = device
        self._line = line

    async def read(self, name: str) -> str:
        """The value of a variable."""
        answer = await self._line.ask(Kind.READ, self._field(name))
        text = self._text(name, answer) if answer.ok else ""
        if not text:  # KUKAVARPROXY reads an unknown variable as an empty value, successfully
            raise DeviceRefused(self._device, f"the proxy cannot read {name} (code {answer.code})", _CURE)
        return text

    async def write(self, name: str, value: str) -> None:
        """Write a variable. That it was taken is the proxy's word only; see `write_verified`."""
        answer = await self._line.ask(Kind.WRITE, self._field(name) + self._field(value))
        if not answer.ok:
            raise DeviceRefused(self._device, f"the proxy cannot write {name} (code {answer.code})", _CURE)

    async def write_verified(self, name: str, value: str) -> None:
        """Write a variable, read it back and compare. Raises DeviceFault if they differ."""
        await self.write(name, value)
        back = await self.read(name)
        if not self._understood(name, lambda text: same(value, text), back):
            what = f"{name} was written as {value} and read back as {back}"
            raise DeviceFault(self._device, what, "Does another program write to this controller's variables?")

    async def whole(self, name: str) -> int:
        """A variable of type INT."""
        return self._understood(name, whole, await self.read(name))

    async def number(self, name: str) -> float:
        """A variable of type INT or REAL."""
        return self._understood(name, number, await self.read(name))

    async def truth(self, name: str) -> bool:
        """A variable of type BOOL."""
        return self._understood(name, truth, await self.read(name))

    async def text(self, name: str) -> str:
        """A text without quotation marks, or an enumeration: `"#EX"`."""
        return plain_text(await self.read(name))

    async def fields(self, name: str) -> dict[str, str]:
        """The fields of a structure."""
        return self._understood(name, fields, await self.read(name))

    async def joints(self, name: str) -> JointReadings:
        """A1 … A6 of a variable of type E6AXIS, degrees."""
        return self._understood(name, joints, await self.read(name))

    def _field(self, text: str) -> bytes:
        try:
            return text_field(text)
        except ValueError as error:
            raise DeviceRefused(self._device, f"{error}; it was not sent") from None

    def _text(self, name: str, answer: Answer) -> str:
        try:
            return answer.text
        except ValueError as error:
            raise DeviceFault(self._device, f"the answer about {name} makes no sense: {error}") from None

    def _understood(self, name: str, read: Callable[[str], Value], text: str) -> Value:
        try:
            return read(text)
        except ValueError as error:
            raise DeviceFault(self._device, f"the value of {name} makes no sense: {error}") from None


@final
class ControllerFiles:
    """Files by the controller's own paths: `KRC:\\R1\\PROGRAM\\cellctl_kvp.dat`."""

    def __init__(self, device: str, line: ProxyLine) -> None:
        self._device = device
        self._line = line

    async def write(self, path: str, content: bytes) -> None:
        """Write a file, read it back and compare.

        Raises DeviceRefused (the server cannot, or not there), DeviceFault (read back it differs), DeviceLost.
        """
        doing = f"write {path}"
        await self._ask(Kind.FILE_WRITE, bytes([_BEGIN]) + _SIZE.pack(len(content)), doing)
        for at in range(0, len(content), CHUNK):
            part = content[at : at + CHUNK]
            head = _CHUNK_HEAD.pack(_DATA, at, len(part))
            taken = await self._ask(Kind.FILE_WRITE, head + part, doing)
            if taken[: _CHUNK_HEAD.size] != head:
                raise DeviceFault(self._device, f"{doing}: the server took another part than was sent", "Write again.")
        await self._ask(Kind.FILE_WRITE, struct.pack(">Bi", _END, _OVERWRITE) + wide_field(path), doing)
        if await self.read(path) != content:
            raise DeviceFault(self._device, f"{doing}: read back it differs", "Write again before anything uses it.")

    async def read(self, path: str) -> bytes:
        """The content of a file. Raises DeviceRefused, DeviceFault, DeviceLost."""
        doing = f"read {path}"
        begun = await self._ask(Kind.FILE_READ, struct.pack(">Bi", _BEGIN, _NONE) + wide_field(path), doing)
        if len(begun) != 1 + _SIZE.size:
            raise DeviceFault(self._device, f"{doing}: the answer has no size")
        (size,) = _SIZE.unpack(begun[1:])
        content = b""
        while len(content) < size:
            asked = _CHUNK_HEAD.pack(_DATA, len(content), min(CHUNK, size - len(content)))
            answer = await self._ask(Kind.FILE_READ, asked, doing)
            part = answer[_CHUNK_HEAD.size :]
            if not part or answer[: _CHUNK_HEAD.size] != _CHUNK_HEAD.pack(_DATA, len(content), len(part)):
                raise DeviceFault(self._device, f"{doing}: the server sent another part than was asked")
            content += part
        await self._ask(Kind.FILE_READ, bytes([_END]), doing)
        return content

    async def _ask(self, kind: Kind, payload: bytes, doing: str) -> bytes:
        answer = await self._line.ask(kind, payload)
        if not answer.ok:
            reason = _CODES.get(answer.code, f"code {answer.code}")
            cure = "Files need a C3 Bridge server of version 1.1.2 or later. Else load them by hand (cellctl krl)."
            raise DeviceRefused(self._device, f"{doing}: refused by the server ({reason})", cure)
        return answer.payload
