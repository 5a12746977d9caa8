"""The serial line: one request at a time, its answer found by transaction number and check sum. All on the loop."""

from __future__ import annotations

import asyncio
import re
from dataclasses import dataclass
from typing import Final, final

from geocompy.communication import crc16_bytewise

from cellctl.clock import Clock
from cellctl.devices import DeviceLost
from drivers.serial_port import SerialPort

_END: Final = b"\r\n"
_LONGEST: Final = 4096
"""Bytes without an end of line after which they are discarded."""
_DEAD_PEER_S: Final = 120.0
"""Wall time: a simulated cell whose time does not advance must not hold a request for ever."""
_ANSWER: Final = re.compile(rb"%R1P,\d+,(\d+),(\d+):\d+(?:,[ -~]*)?")
_REQUEST: Final = re.compile(r"%R1Q,\d+,(\d+)")
_INTERRUPTED: Final = 8
_UNREADABLE: Final = ""
"""In place of a line without the form of an answer with a check sum: geocompy would take one without."""
_ABORT: Final = b"c"
_ABORTED: Final = b"?"
"""The answer to an abort, and then the only one to the request that it interrupted."""


@final
@dataclass(slots=True)
class Counts:
    """Counts of the line since it was opened. stray: valid answers to no request in flight: late or doubled ones."""

    requests: int = 0
    missing: int = 0
    garbled: int = 0
    stray: int = 0


@final
class Line:
    """The open line. Raises DeviceLost once the port is lost."""

    def __init__(self, device: str, port: SerialPort, clock: Clock) -> None:
        self.counts = Counts()
        self._device, self._port, self._clock = device, port, clock
        self._wire = clock.wire(device)
        self._buffer = b""
        self._awaited: tuple[int, asyncio.Future[str]] | None = None
        self._interrupted: int | None = None
        self._clear_first = True
        self._why_lost = ""
        self._loop = asyncio.get_running_loop()
        self._reading: int | None = port.fileno()
        self._loop.add_reader(self._reading, self._readable)

    @property
    def in_flight(self) -> bool:
        """Whether a request waits for its answer."""
        return self._awaited is not None

    def check(self) -> None:
        """Raises DeviceLost if the port was lost."""
        if self._why_lost:
            raise DeviceLost(self._device, self._why_lost, "check the cable, the adapter and the instrument's supply")

    async def ask(self, request: str, within_s: float) -> str:
        """Send a request without its end, and return the answer without its end, whether its check sum is right or not.

        within_s: of the cell's time. Raises TimeoutError without an answer, DeviceLost.
        """
        answer: asyncio.Future[str] = self._loop.create_future()
        self._awaited = _transaction(request), answer
        self.counts.requests += 1
        try:
            self._send(request)
            async with asyncio.timeout(_DEAD_PEER_S), self._clock.timeout(within_s):
                return await answer
        except TimeoutError:
            self.counts.missing += 1
            self._clear_first = True
            raise
        finally:
            self._awaited = None

    def abort(self) -> None:
        """Interrupt the motion in progress: its request then ends with return code 8."""
        self._interrupted = self._awaited[0] if self._awaited else None
        if not self._why_lost:
            self._write(_ABORT + _END)

    def close(self) -> None:
        """Close the port."""
        self._release()
        self._port.close()

    def _send(self, request: str) -> None:
        """A line feed first empties the instrument's receive buffer, after anything went wrong."""
        self.check()
        clear, self._clear_first = b"\n" if self._clear_first else b"", False
        self._write(clear + request.encode("ascii") + _END)
        self.check()

    def _write(self, data: bytes) -> None:
        try:
            self._port.write(data)
            self._wire.wrote(len(data))
        except OSError as error:
            self._lose(f"the port takes nothing more ({error})")

    def _readable(self) -> None:
        try:
            data = self._port.read()
        except (OSError, TypeError) as error:
            self._lose(f"the port was lost ({error})")
            return
        *lines, rest = (self._buffer + data).split(b"\n")
        self._buffer = rest[-_LONGEST:]
        for line in lines:
            self._take(line.strip(b"\r"))
        self._wire.read(len(data))

    def _take(self, line: bytes) -> None:
        if line == _ABORTED:
            self._answer_aborted()
        if line in (b"", _ABORTED):
            return
        transaction = _valid_transaction(line)
        if transaction is None:
            self.counts.garbled += 1
            self._clear_first = True
        if self._awaited and transaction in (None, self._awaited[0]) and not self._awaited[1].done():
            self._awaited[1].set_result(line.decode("ascii") if _ANSWER.fullmatch(line) else _UNREADABLE)
        elif transaction is not None:
            self.counts.stray += 1

    def _answer_aborted(self) -> None:
        """In place of the answer that an interrupted request does not get: return code 8, with its check sum."""
        if self._awaited and self._awaited[0] == self._interrupted and not self._awaited[1].done():
            head, tail = f"%R1P,0,{self._awaited[0]}", f":{_INTERRUPTED}"
            self._awaited[1].set_result(f"{head},{crc16_bytewise(head + tail)}{tail}")

    def _lose(self, why: str) -> None:
        self._why_lost = self._why_lost or why
        self._release()
        if self._awaited and not self._awaited[1].done():
            self._awaited[1].set_exception(DeviceLost(self._device, why, "check the cable and the adapter"))

    def _release(self) -> None:
        if self._reading is not None:
            self._loop.remove_reader(self._reading)
            self._wire.close()
        self._reading = None


def _transaction(request: str) -> int:
    match = _REQUEST.match(request)
    return int(match[1]) if match else -1


def _valid_transaction(line: bytes) -> int | None:
    """The transaction number of an answer whose check sum is right; None for every other line."""
    match = _ANSWER.fullmatch(line)
    if match is None:
        return None
    start, end = match.span(2)
    body = line[: start - 1] + line[end:]
    return int(match[1]) if crc16_bytewise(body) == int(match[2]) else None
