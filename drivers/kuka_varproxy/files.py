"""Files on the controller, by the C3 Bridge's messages 29 and 30; KUKAVARPROXY has none.

Source: C3 Bridge Interface Protocol 1.5, section 3.9; where its text and its public server disagree (length of the name
in message 30) this follows the server.
"""

from __future__ import annotations

import struct
from typing import final

from cellctl.devices import DeviceFault, DeviceRefused
from drivers.kuka_varproxy.line import ProxyLine
from drivers.kuka_varproxy.messages import Kind, wide_field

CHUNK = 16_384
"""Bytes of a file per message."""

_BEGIN, _DATA, _END = 1, 2, 4
_OVERWRITE = 64
_NONE = 0
_CODES = {0: "general error", 2: "access denied", 3: "wrong argument", 7: "not implemented", 9: "protocol error"}
_SIZE = struct.Struct(">I")
_CHUNK_HEAD = struct.Struct(">BII")


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
