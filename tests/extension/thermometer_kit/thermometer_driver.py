"""Driver of an invented thermometer: one line of text asks, one answers, over TCP."""

import asyncio
from contextlib import suppress
from typing import Protocol

from cellctl.devices import Device, DeviceLost, DeviceUnreachable, DriverDescription, Health, Identity, observes

ANSWER_S = 1.0


@observes
class TemperatureSource(Device, Protocol):
    """A device that measures a temperature."""

    async def temperature(self) -> float:
        """The temperature, °C: `21.3`. Raises DeviceLost."""


class Thermometer:
    """The thermometer at `thermometer+tcp://HOST:PORT`."""

    def __init__(self, name, place, clock):
        self.name, self._place, self._clock = name, place, clock
        self._reader = self._writer = self._wire = None

    async def connect(self):
        try:
            with self._clock.standing():
                self._reader, self._writer = await asyncio.open_connection(*self._place)
                self._wire = self._clock.wire(self.name)
        except OSError as error:
            raise DeviceUnreachable(self.name, f"no connection to {self._place}: {error}") from error
        serial = await self._ask("WHO")
        return Identity(self.name, serial, "thermometer", "1", serial.startswith("SIM-"))

    async def temperature(self):
        return float(await self._ask("READ"))

    async def health(self):
        return Health(True, f"{await self.temperature():.1f} °C")

    async def stop(self):
        """It moves nothing."""

    async def close(self):
        if self._writer:
            self._writer.close()
            self._wire.close()
            with suppress(OSError), self._clock.standing():
                await self._writer.wait_closed()

    async def _ask(self, question):
        line = f"{question}\n".encode()
        self._writer.write(line)
        self._wire.wrote(len(line))
        try:
            async with self._clock.timeout(ANSWER_S):
                answer = await self._reader.readline()
        except TimeoutError:
            raise DeviceLost(self.name, f"no answer to {question} for {ANSWER_S:g} s", "look at its cable") from None
        self._wire.read(len(answer))
        return answer.decode().strip()


def open_thermometer(name, address, surroundings):
    """Opens nothing."""
    if not address.host or address.port is None:
        raise ValueError(f"'{address}' needs a host and a port")
    return Thermometer(name, (address.host, address.port), surroundings.clock)


DRIVER = DriverDescription(open=open_thermometer, abilities=TemperatureSource)
