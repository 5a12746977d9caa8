"""The Dashboard server: identity, power and programs by lines of text; one request after the other.

Source: Universal Robots, Dashboard Server e-Series / CB3 (port 29999). The server greets with a line, and answers each
request with one.
"""

from __future__ import annotations

import asyncio
from typing import final

from cellctl.clock import Clock, Wire
from cellctl.devices import DeviceLost, DeviceUnreachable

ANSWER_S = 5.0
_OPEN_S = 5.0


@final
class Dashboard:
    """One connection to the Dashboard server; its bytes count on the robot's `wire`."""

    def __init__(self, device: str, place: tuple[str, int], clock: Clock) -> None:
        self._device, self._place, self._clock = device, place, clock
        self._reader: asyncio.StreamReader | None = None
        self._writer: asyncio.StreamWriter | None = None
        self._wire: Wire | None = None

    async def open(self, wire: Wire) -> None:
        """Connect and read the greeting. Raises DeviceUnreachable, DeviceLost."""
        host, port = self._place
        try:
            with self._clock.standing():
                async with asyncio.timeout(_OPEN_S):
                    self._reader, self._writer = await asyncio.open_connection(host, port)
        except (OSError, TimeoutError) as error:
            cure = "Is the Dashboard server released (Settings, Security, Services)?"
            raise DeviceUnreachable(self._device, f"no Dashboard server at {host}:{port} ({error})", cure) from error
        self._wire = wire
        await self._line()

    async def close(self) -> None:
        """Close the connection."""
        if self._writer:
            self._writer.close()
            self._reader = self._writer = None

    async def ask(self, request: str) -> str:
        """The answer to a request. Raises DeviceLost."""
        if self._writer is None or self._wire is None:
            raise DeviceLost(self._device, "not connected")
        data = f"{request}\n".encode("ascii")
        self._writer.write(data)
        self._wire.wrote(len(data))
        return await self._line()

    async def _line(self) -> str:
        if self._reader is None or self._wire is None:
            raise DeviceLost(self._device, "not connected")
        try:
            async with self._clock.timeout(ANSWER_S):
                data = await self._reader.readline()
        except (OSError, TimeoutError, ValueError) as error:
            await self.close()
            raise DeviceLost(self._device, f"the Dashboard server did not answer within {ANSWER_S:g} s") from error
        self._wire.read(len(data))
        if not data.endswith(b"\n"):
            await self.close()
            raise DeviceLost(self._device, "the Dashboard server closed the connection")
        return data.decode("latin-1").strip()
