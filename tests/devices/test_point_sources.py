"""An instrument that streams over Ethernet fulfils the same Protocol as one that is asked for each point."""

from __future__ import annotations

import asyncio
import math
import struct

from cellctl.clock import WallClock
from cellctl.devices import (
    Health,
    Identity,
    Lock,
    MeasuredPoint,
    PointSource,
    Reflector,
    TargetLost,
    TwoFaceError,
    Weather,
)

RECORD = struct.Struct("<Iddd?")
"""Device time in ms, x, y, z in mm, whether the beam holds."""


class StreamingTracker:
    """Receives datagrams all the time; a measurement is the mean of the next ones."""

    name = "tracker"

    def __init__(self) -> None:
        self.clock = WallClock()
        self._records: asyncio.Queue[tuple] = asyncio.Queue()
        self._locked = False
        self._weather: Weather | None = None

    async def connect(self) -> Identity:
        class Receiver(asyncio.DatagramProtocol):
            def datagram_received(_, data: bytes, _address: object) -> None:  # noqa: N805
                self._records.put_nowait(RECORD.unpack(data))

        loop = asyncio.get_running_loop()
        self._transport, _ = await loop.create_datagram_endpoint(Receiver, local_addr=("127.0.0.1", 0))
        return Identity(self.name, "1", "streaming", "1", True)

    @property
    def port(self) -> int:
        return self._transport.get_extra_info("sockname")[1]

    async def health(self) -> Health:
        return Health(True, "streaming")

    async def stop(self) -> None:
        pass

    async def close(self) -> None:
        self._transport.close()

    async def initialise(self, reflector: Reflector) -> None:
        self._reflector = reflector

    async def set_weather(self, weather: Weather) -> None:
        self._weather = weather

    async def aim(self, place, search_mm: float) -> None:
        *_, held = await self._records.get()
        if not held:
            raise TargetLost(self.name, "no reflector in the beam", "aim again")
        self._locked = True

    async def lock(self) -> Lock:
        return Lock.LOCKED if self._locked else Lock.NONE

    async def measure(self, samples: int, *, faces: int = 1) -> MeasuredPoint:
        records = [await self._records.get() for _ in range(samples)]
        if not all(record[4] for record in records):
            self._locked = False
            raise TargetLost(self.name, "the beam was broken", "aim again")
        xyz = tuple(sum(record[axis] for record in records) / samples for axis in (1, 2, 3))
        flat = ((1e-4, 0.0, 0.0), (0.0, 1e-4, 0.0), (0.0, 0.0, 1e-4))
        return MeasuredPoint(
            xyz=xyz,
            covariance=flat,
            common=flat,
            samples=samples,
            scatter=(0.0, 0.0, 0.0),
            faces=faces,
            hz_rad=0.0,
            v_rad=0.0,
            range_mm=math.hypot(*xyz),
            time_ns=self.clock.now_ns(),
            device_ms=records[-1][0],
            levelled=False,
            weather=self._weather,
            accuracy="streaming",
            noise_only=False,
        )

    async def two_face_error(self, samples: int) -> TwoFaceError:
        return TwoFaceError(0.0, 0.0, 0.0, 0.0, 0.0)

    async def levelled(self) -> bool:
        return False


async def measured_by(source: PointSource, send) -> MeasuredPoint:
    """A caller that knows the Protocol alone."""
    await source.initialise(Reflector(constant_mm=0.0))
    send(0, 10.0, 0.0, 0.0, True)
    await source.aim((10.0, 0.0, 0.0), 5.0)
    assert await source.lock() is Lock.LOCKED
    for index, x in enumerate((10.0, 11.0, 12.0)):
        send(index + 1, x, 20.0, 30.0, True)
    point = await source.measure(3)
    send(9, 10.0, 0.0, 0.0, False)
    try:
        await source.measure(1)
    except TargetLost:
        return point
    raise AssertionError("a broken beam was measured")


def test_a_streaming_instrument_is_a_point_source_to_its_caller():
    async def session() -> None:
        tracker = StreamingTracker()
        assert isinstance(tracker, PointSource)
        await tracker.connect()
        loop = asyncio.get_running_loop()
        out, _ = await loop.create_datagram_endpoint(asyncio.DatagramProtocol, remote_addr=("127.0.0.1", tracker.port))
        try:
            async with asyncio.timeout(10):
                point = await measured_by(tracker, lambda *record: out.sendto(RECORD.pack(*record)))
            assert point.xyz == (11.0, 20.0, 30.0)
            assert point.device_ms == 3
        finally:
            out.close()
            await tracker.close()

    asyncio.run(session())
