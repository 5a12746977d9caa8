"""Modbus TCP frames: the MBAP header (transaction, protocol 0, length, unit) before each PDU. Pure.

Source: MODBUS Messaging on TCP/IP Implementation Guide V1.0b, 3.1.3. All numbers are big-endian.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import final

LONGEST_PDU = 253
_HEADER = struct.Struct(">HHHB")


@final
@dataclass(frozen=True, slots=True)
class Frame:
    """A request or an answer. `pdu`: function code and data."""

    transaction: int
    unit: int
    pdu: bytes

    def encode(self) -> bytes:
        """As it goes over the wire."""
        return _HEADER.pack(self.transaction, 0, len(self.pdu) + 1, self.unit) + self.pdu


@final
class FrameStream:
    """Cuts a TCP stream into frames, however the bytes arrive.

    `broken`: a header was no Modbus header, so that nothing behind it can be read: the connection is of no more use.
    """

    def __init__(self) -> None:
        self.broken = False
        self._rest = b""

    def feed(self, data: bytes) -> Iterator[Frame]:
        """The frames that `data` completes."""
        self._rest += data
        while not self.broken and len(self._rest) >= _HEADER.size:
            transaction, protocol, length, unit = _HEADER.unpack_from(self._rest)
            if protocol != 0 or not 2 <= length <= LONGEST_PDU + 1:
                self.broken = True
                return
            end = 6 + length
            if len(self._rest) < end:
                return
            pdu, self._rest = self._rest[_HEADER.size : end], self._rest[end:]
            yield Frame(transaction, unit, pdu)
