"""A connected tracker on a scripted station."""

from __future__ import annotations

import asyncio

import pytest

from cellctl.devices import Reflector
from tests.helpers.station import Station, tracker_at


@pytest.fixture
def station():
    station = Station()
    yield station
    station.close()


@pytest.fixture
def run(station):
    """Run a coroutine function with a connected tracker; the station listens on the same loop."""

    def go(work, *, accuracy: str = "tdra6000", initialised: bool = True):
        async def session():
            station.listen()
            tracker = tracker_at(station, accuracy)
            try:
                async with asyncio.timeout(30):
                    await tracker.connect()
                    if initialised:
                        await tracker.initialise(Reflector(constant_mm=-16.9, centring_mm=0.01))
                    station.requests.clear()
                    return await work(tracker)
            finally:
                await tracker.close()

        return asyncio.run(session())

    return go
