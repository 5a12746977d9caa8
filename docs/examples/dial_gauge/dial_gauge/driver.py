"""Driver of a dial gauge on a serial line: it answers `ID?` with its serial number, and `?` with its reading in mm."""

from __future__ import annotations

import asyncio
from typing import Protocol

from cellctl.clock import Clock, Wire
from cellctl.devices import (
    Address,
    Device,
    DeviceFault,
    DeviceLost,
    DriverDescription,
    Health,
    Identity,
    Surroundings,
    observes,
)
from drivers.serial_port import SerialPlace, SerialPort, open_port

BAUD = 4800
ANSWER_S, MOST_ANSWER_S = 1.0, 10.0
"""Default and ceiling of the limit `answer_s`: the longest wait for an answer, s of the cell's time."""


@observes
class LengthSource(Device, Protocol):
    """A device that measures a length along its axis."""

    async def length(self) -> float:
        """The reading, mm: `1.274`. Raises DeviceLost, DeviceFault."""


class DialGauge:
    """The dial gauge `name` at a serial port; `connect` opens it. answer_s: see `ANSWER_S`."""

    def __init__(self, name: str, place: SerialPlace, clock: Clock, answer_s: float) -> None:
        self.name = name
        self._place, self._clock, self._answer_s = place, clock, answer_s
        self._port: SerialPort | None = None
        self._wire: Wire | None = None
        self._received = b""
        self._answer: asyncio.Future[str] | None = None

    async def connect(self) -> Identity:
        """Open the port and read the serial number. Raises DeviceUnreachable, DeviceLost."""
        self._port = open_port(self.name, self._place)
        self._wire = self._clock.wire(self.name)
        asyncio.get_running_loop().add_reader(self._port.fileno(), self._readable)
        serial = await self._ask("ID?")
        return Identity(self.name, serial, "dial gauge", "", simulated=serial.startswith("SIM-"))

    async def length(self) -> float:
        """The reading, mm. Raises DeviceLost, DeviceFault."""
        text = await self._ask("?")
        try:
            return float(text)
        except ValueError:
            raise DeviceFault(self.name, f"answered '{text}', which is no number") from None

    async def health(self) -> Health:
        """The reading. Raises DeviceLost."""
        reading = await self.length()
        return Health(ok=True, text=f"{reading:+.3f} mm", figures={"mm": reading})

    async def stop(self) -> None:
        """It moves nothing."""

    async def close(self) -> None:
        """Close the port."""
        if self._port and self._wire:
            asyncio.get_running_loop().remove_reader(self._port.fileno())
            self._wire.close()
            self._port.close()
        self._port = self._wire = None

    async def _ask(self, question: str) -> str:
        if not (self._port and self._wire):
            raise DeviceLost(self.name, "the port is closed", "connect first")
        self._answer = asyncio.get_running_loop().create_future()
        line = f"{question}\r".encode()
        try:
            self._port.write(line)
            self._wire.wrote(len(line))
            async with self._clock.timeout(self._answer_s):
                return await self._answer
        except TimeoutError:
            why = f"no answer to {question} for {self._answer_s:g} s"
            raise DeviceLost(self.name, why, "look at its cable and its battery") from None
        except OSError as error:
            raise DeviceLost(self.name, f"the port was lost ({error})", "look at its cable") from error
        finally:
            self._answer = None

    def _readable(self) -> None:
        """Take what has arrived; the wire counts it when the waiting question has its answer."""
        assert self._port
        assert self._wire
        try:
            data = self._port.read()
        except OSError as error:
            asyncio.get_running_loop().remove_reader(self._port.fileno())
            if self._answer and not self._answer.done():
                self._answer.set_exception(error)
            return
        *lines, self._received = (self._received + data).split(b"\r")
        for line in lines:
            if self._answer and not self._answer.done():
                self._answer.set_result(line.decode("ascii", "replace").strip())
        self._wire.read(len(data))


def open_gauge(name: str, address: Address, surroundings: Surroundings) -> DialGauge:
    """The dial gauge at `dial-gauge+serial:///dev/ttyUSB0?baud=4800`; opens nothing. Raises ValueError."""
    place = SerialPlace.of(address, BAUD)
    if unknown := sorted(set(address.query) - {"baud"}):
        raise ValueError(f"'{address}': the setting '{unknown[0]}' is not known; there is baud")
    if unknown := sorted(set(surroundings.limits) - {"answer_s"}):
        raise ValueError(f"the limit '{unknown[0]}' is not known; there is answer_s")
    answer_s = surroundings.limits.get("answer_s", ANSWER_S)
    if not 0 < answer_s <= MOST_ANSWER_S:
        raise ValueError(f"the limit answer_s is {answer_s:g}; above 0 and at most {MOST_ANSWER_S:g} is allowed")
    return DialGauge(name, place, surroundings.clock, answer_s)


DRIVER = DriverDescription(open=open_gauge, abilities=LengthSource)
