"""One Modbus TCP connection: one request at a time, each with its time limit; the protocol's exceptions with a cure.

Source: MODBUS Application Protocol Specification V1.1b3, chapter 7.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable
from contextlib import suppress
from typing import Any, final

from pymodbus.client import AsyncModbusTcpClient
from pymodbus.exceptions import ModbusException
from pymodbus.pdu import ExceptionResponse, ModbusPDU

from cellctl.clock import Clock
from cellctl.devices import DeviceBusy, DeviceError, DeviceFault, DeviceLost, DeviceRefused, DeviceUnreachable

_MAP_CURE = "compare the PLC's Modbus server with the I/O map in docs/connecting-a-plc.md"


def refusal(device: str, doing: str, code: int) -> DeviceError:
    """The error for an exception response; `doing`: the request in words."""
    match code:
        case 1:
            return DeviceRefused(device, f"{doing}: the PLC does not know this function (exception 01)", _MAP_CURE)
        case 2:
            return DeviceRefused(device, f"{doing}: the PLC does not have this address (exception 02)", _MAP_CURE)
        case 3:
            return DeviceRefused(device, f"{doing}: the PLC does not take this value (exception 03)", _MAP_CURE)
        case 4:
            cure = "look at the PLC's diagnosis: its program or one of its modules has failed"
            return DeviceFault(device, f"{doing}: the PLC failed (exception 04)", cure)
        case 5 | 6:
            return DeviceBusy(device, f"{doing}: the PLC is busy (exception {code:02X})", "ask again later")
        case 0x0A | 0x0B:
            cure = "check 'unit' in the address; a PLC without a gateway usually has unit 1"
            return DeviceLost(device, f"{doing}: the gateway finds no PLC of this unit (exception {code:02X})", cure)
    return DeviceRefused(device, f"{doing}: the PLC refused (exception {code:02X})", _MAP_CURE)


logging.getLogger("pymodbus").addHandler(logging.NullHandler())
"""What the library logs is in this driver's errors; without a handler it would appear on the operator's terminal."""

ANSWER_S = 1.0
"""Longest wait for an answer, in the cell's time."""

_CONNECT_S = 10.0
_DEAD_S = 600.0
"""Wall time after which the library gives up. A guard against a dead peer: the cell's time may stand for long."""

_LOST_CURE = "check the network cable, the PLC's supply, and that its Modbus server runs"

Request = Callable[[AsyncModbusTcpClient], Awaitable[ModbusPDU]]


@final
class ModbusLine:
    """A connection, from `open` to `close`. It never repeats a request: a write could be carried out twice.

    After a time-out or a loss it is of no more use. pymodbus matches the transaction numbers of answers.
    """

    def __init__(self, device: str, host: str, port: int, unit: int, clock: Clock) -> None:
        self.unit = unit
        self.latency_s = 0.0
        self._device, self._place, self._clock = device, f"{host}:{port}", clock
        self._lost = ""
        self._asking = asyncio.Lock()
        self._wire = clock.wire(device)
        self._client = AsyncModbusTcpClient(
            host,
            port=port,
            name=device,
            retries=0,
            reconnect_delay=0,
            timeout=_CONNECT_S,
            trace_packet=self._sent,
            trace_connect=self._connected,
        )
        self._library_receives = self._client.ctx.data_received
        self._client.ctx.data_received = self._received  # type: ignore[method-assign]

    async def open(self) -> None:
        """Connect. Raises DeviceUnreachable."""
        with self._clock.standing():
            if await self._client.connect():
                self._client.ctx.comm_params.timeout_connect = _DEAD_S  # the library uses it for answers too
                self._wire = self._clock.wire(self._device)
                return
        what = f"no Modbus connection to {self._place}"
        raise DeviceUnreachable(self._device, what, f"{_LOST_CURE}; is the address right?")

    async def ask(self, doing: str, request: Request) -> Any:
        """The answer to a request; `doing`: the request in words.

        Raises DeviceLost (no answer, connection lost: it is not known whether a write was carried out), DeviceRefused,
        DeviceBusy, DeviceFault.
        """
        async with self._asking:
            self._check(doing)
            sent_ns = self._clock.now_ns()
            try:
                async with self._clock.timeout(ANSWER_S):
                    answer = await request(self._client)
            except TimeoutError:
                self._end(f"no answer within {ANSWER_S:g} s")
            except ModbusException as error:
                self._end(f"the connection broke: {error.string}")
            self._check(doing)
            self.latency_s = (self._clock.now_ns() - sent_ns) * 1e-9
        if isinstance(answer, ExceptionResponse):
            raise refusal(self._device, doing, answer.exception_code)
        return answer

    async def close(self) -> None:
        """Close the connection, before another can be opened: the PLC then sees them in this order."""
        transport = self._client.ctx.transport
        self._end("the connection was closed")
        socket = transport.get_extra_info("socket") if transport else None
        while socket is not None and socket.fileno() >= 0:
            await asyncio.sleep(0)  # the loop closes it in its next turn

    def _check(self, doing: str) -> None:
        if self._lost:
            raise DeviceLost(self._device, f"{doing}: {self._lost} ({self._place})", _LOST_CURE)

    def _end(self, why: str) -> None:
        """Close the connection, and end the request in progress: the library would let it wait."""
        self._lost = self._lost or why
        if transport := self._client.ctx.transport:
            transport.abort()  # type: ignore[attr-defined]
        self._client.close()
        self._wire.close()
        answer = self._client.ctx.response_future
        with suppress(asyncio.InvalidStateError):
            answer.set_exception(ModbusException(why))
            answer.exception()  # retrieved: nobody may wait for it

    # Callbacks of the library

    def _sent(self, sending: bool, data: bytes) -> bytes:
        if sending:
            self._wire.wrote(len(data))
        return data

    def _received(self, data: bytes) -> None:
        """Count what comes, then let the library read it. Its own callback would count unread bytes twice."""
        try:
            self._library_receives(data)
        except ModbusException as error:  # an answer of the right number that is no Modbus
            self._end(f"an answer cannot be read: {error.string}")
        self._wire.read(len(data))

    def _connected(self, connected: bool) -> None:
        if not connected:
            self._end("the PLC closed the connection")
