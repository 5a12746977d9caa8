"""Modbus TCP: frames with their MBAP header, and the functions, a request PDU in, the answer's PDU out. Pure.

Source: MODBUS Messaging on TCP/IP Implementation Guide V1.0b, 3.1.3. All numbers are big-endian.

Source: MODBUS Application Protocol Specification V1.1b3, chapter 6. Functions 1, 2, 3, 4, 5, 6, 15, 16, and 43/14 (read
device identification). Exceptions: 01 unknown function, 02 an address outside the table, 03 a value or number outside
its range.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol, final
from urllib.parse import parse_qsl, urlsplit

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


ILLEGAL_FUNCTION, ILLEGAL_ADDRESS, ILLEGAL_VALUE, NO_TARGET = 1, 2, 3, 0x0B

MOST_BITS_READ, MOST_REGISTERS_READ, MOST_BITS_WRITTEN, MOST_REGISTERS_WRITTEN = 2000, 125, 1968, 123


class ModbusException(Exception):
    """The request is answered with this exception code."""

    def __init__(self, code: int) -> None:
        self.code = code
        super().__init__(code)


class Tables(Protocol):
    """The PLC's memory. Reads give a whole table, from address 0; writes raise ModbusException."""

    def discrete_inputs(self) -> Sequence[bool]:
        """Function 2."""

    def coils(self) -> Sequence[bool]:
        """Function 1."""

    def input_registers(self) -> Sequence[int]:
        """Function 4."""

    def holding_registers(self) -> Sequence[int]:
        """Function 3."""

    def write_coils(self, first: int, values: Sequence[bool]) -> None:
        """Functions 5 and 15."""

    def write_registers(self, first: int, values: Sequence[int]) -> None:
        """Functions 6 and 16."""

    def identification(self) -> Sequence[str]:
        """Function 43/14: vendor, product code, revision."""


def answer(pdu: bytes, tables: Tables) -> bytes:
    """The answer to a request."""
    function = pdu[0]
    try:
        if function not in _FUNCTIONS:
            raise ModbusException(ILLEGAL_FUNCTION)
        return pdu[:1] + _FUNCTIONS[function](pdu[1:], tables)
    except ModbusException as error:
        return exception(pdu, error.code)


def exception(pdu: bytes, code: int) -> bytes:
    """The answer that refuses a request with this code."""
    return bytes((pdu[0] | 0x80, code))


def _two(data: bytes) -> tuple[int, int]:
    """Two 16-bit numbers, and nothing behind them."""
    if len(data) != 4:
        raise ModbusException(ILLEGAL_VALUE)
    first, second = struct.unpack(">HH", data)
    return first, second


def _part(data: bytes, table: Sequence[int], most: int) -> Sequence[int]:
    """The values that a read asks for."""
    first, count = _two(data)
    if not 1 <= count <= most:
        raise ModbusException(ILLEGAL_VALUE)
    if first + count > len(table):
        raise ModbusException(ILLEGAL_ADDRESS)
    return table[first : first + count]


def _bits(table: Callable[[Tables], Sequence[bool]]) -> Callable[[bytes, Tables], bytes]:
    def read(data: bytes, tables: Tables) -> bytes:
        bits = _part(data, table(tables), MOST_BITS_READ)
        packed = bytearray((len(bits) + 7) // 8)
        for i, bit in enumerate(bits):
            packed[i // 8] |= bool(bit) << i % 8  # the first one in the lowest bit
        return bytes((len(packed),)) + packed

    return read


def _registers(table: Callable[[Tables], Sequence[int]]) -> Callable[[bytes, Tables], bytes]:
    def read(data: bytes, tables: Tables) -> bytes:
        values = _part(data, table(tables), MOST_REGISTERS_READ)
        return struct.pack(f">B{len(values)}H", 2 * len(values), *values)

    return read


def _write_coil(data: bytes, tables: Tables) -> bytes:
    address, value = _two(data)
    if value not in (0x0000, 0xFF00):
        raise ModbusException(ILLEGAL_VALUE)
    _within(address, 1, tables.coils())
    tables.write_coils(address, [value == 0xFF00])
    return data


def _write_register(data: bytes, tables: Tables) -> bytes:
    address, value = _two(data)
    _within(address, 1, tables.holding_registers())
    tables.write_registers(address, [value])
    return data


def _write_coils(data: bytes, tables: Tables) -> bytes:
    first, count, packed = _many(data, MOST_BITS_WRITTEN, lambda count: (count + 7) // 8)
    _within(first, count, tables.coils())
    tables.write_coils(first, [bool(packed[i // 8] >> i % 8 & 1) for i in range(count)])
    return data[:4]


def _write_registers(data: bytes, tables: Tables) -> bytes:
    first, count, packed = _many(data, MOST_REGISTERS_WRITTEN, lambda count: 2 * count)
    _within(first, count, tables.holding_registers())
    tables.write_registers(first, struct.unpack(f">{count}H", packed))
    return data[:4]


def _many(data: bytes, most: int, size: Callable[[int], int]) -> tuple[int, int, bytes]:
    """First address, number and packed values of a write of several."""
    if len(data) < 5:
        raise ModbusException(ILLEGAL_VALUE)
    (first, count), stated, packed = _two(data[:4]), data[4], data[5:]
    if not 1 <= count <= most or not stated == len(packed) == size(count):
        raise ModbusException(ILLEGAL_VALUE)
    return first, count, packed


def _within(first: int, count: int, table: Sequence[int]) -> None:
    if first + count > len(table):
        raise ModbusException(ILLEGAL_ADDRESS)


def _identify(data: bytes, tables: Tables) -> bytes:
    """43/14: the three basic objects, as a stream."""
    if data[:1] != b"\x0e":
        raise ModbusException(ILLEGAL_FUNCTION)
    if len(data) != 3 or data[1] not in (1, 2, 3):
        raise ModbusException(ILLEGAL_VALUE)
    objects = list(enumerate(text.encode("ascii") for text in tables.identification()))[data[2] :]
    if not objects:
        raise ModbusException(ILLEGAL_ADDRESS)
    head = bytes((0x0E, data[1], 0x01, 0x00, 0x00, len(objects)))
    return head + b"".join(bytes((number, len(text))) + text for number, text in objects)


_FUNCTIONS: dict[int, Callable[[bytes, Tables], bytes]] = {
    1: _bits(lambda tables: tables.coils()),
    2: _bits(lambda tables: tables.discrete_inputs()),
    3: _registers(lambda tables: tables.holding_registers()),
    4: _registers(lambda tables: tables.input_registers()),
    5: _write_coil,
    6: _write_register,
    15: _write_coils,
    16: _write_registers,
    43: _identify,
}


HEARTBEAT = "plc.heartbeat"
UNIT = 1


def unit_of(address: str) -> int:
    """The unit id in the address. Raises ValueError where that is no number from 0 to 255."""
    unit = int(_query(address).get("unit", UNIT))
    if not 0 <= unit <= 255:
        raise ValueError(f"unit {unit}")
    return unit


def low_first(address: str) -> bool:
    """Whether the low word of a 32-bit value comes first."""
    return _query(address).get("words") == "low_first"


def _query(address: str) -> dict[str, str]:
    return dict(parse_qsl(urlsplit(address).query))
