"""The C3 Bridge's messages about files, for one connection: a buffer to write, a buffer to read."""

from __future__ import annotations

from typing import final

from sims.varproxy.frames import ACCESS, GENERAL, NOT_IMPLEMENTED, SUCCESS, Fields

WRITE, READ = 29, 30
LARGEST_CHUNK = 60_000
LARGEST_FILE = 1 << 24

_BEGIN, _DATA, _SIZE, _END = 1, 2, 3, 4
_OVERWRITE = 64


@final
class FileDesk:
    """`files`: path → content, of the whole controller. Each request gives code and payload. Raises BadRequest."""

    def __init__(self, files: dict[str, bytes]) -> None:
        self._files = files
        self._out = bytearray()
        self._in = b""

    def write(self, fields: Fields) -> tuple[int, bytes]:
        """Message 29."""
        operation = fields.number(1)
        if operation == _BEGIN:
            size = fields.number(4)
            if size > LARGEST_FILE:
                return GENERAL, bytes([operation]) + _four(0)
            self._out = bytearray(size)
            return SUCCESS, bytes([operation]) + _four(size)
        if operation == _SIZE:
            return SUCCESS, bytes([operation]) + _four(len(self._out))
        if operation == _DATA:
            at, size = fields.number(4), fields.number(4)
            size = max(0, min(size, len(self._out) - at))
            self._out[at : at + size] = fields.take(size)
            return SUCCESS, bytes([operation]) + _four(at) + _four(size)
        if operation == _END:
            flags, path = fields.number(4), fields.wide_text().upper()
            if path in self._files and not flags & _OVERWRITE:
                return ACCESS, bytes([operation])
            self._files[path] = bytes(self._out)
            self._out = bytearray()
            return SUCCESS, bytes([operation])
        return NOT_IMPLEMENTED, bytes([operation])

    def read(self, fields: Fields) -> tuple[int, bytes]:
        """Message 30."""
        operation = fields.number(1)
        if operation == _BEGIN:
            fields.number(4)
            content = self._files.get(fields.wide_text().upper())
            self._in = content or b""
            return GENERAL if content is None else SUCCESS, bytes([operation]) + _four(len(self._in))
        if operation == _SIZE:
            return SUCCESS, bytes([operation]) + _four(len(self._in))
        if operation == _DATA:
            at, size = fields.number(4), min(fields.number(4), LARGEST_CHUNK)
            part = self._in[at : at + size]
            return SUCCESS, bytes([operation]) + _four(at) + _four(len(part)) + part
        if operation == _END:
            self._in = b""
            return SUCCESS, bytes([operation])
        return NOT_IMPLEMENTED, bytes([operation])


def _four(value: int) -> bytes:
    return value.to_bytes(4, "big")
