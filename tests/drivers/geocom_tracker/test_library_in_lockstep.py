"""geocompy in a thread: the cell's time stops while it computes and runs while the instrument works."""

from __future__ import annotations

import asyncio
import threading

import pytest

from cellctl.devices import DeviceLost
from drivers.geocom_tracker.line import Library, Line
from drivers.serial_port import SerialPlace, open_port
from tests.helpers.station import TEMPERATURE, Station


def with_library(station: Station, work):
    async def session():
        station.listen()
        line = Line("tracker", open_port("tracker", SerialPlace(station.path, 115200, "")), station.clock)
        library = Library("tracker", line, station.clock)
        try:
            async with asyncio.timeout(30):
                return await work(library, line)
        finally:
            library.close()
            line.close()

    return asyncio.run(session())


def test_time_stops_while_the_library_computes_and_runs_while_the_instrument_works(station):
    standing_in_library, threads = [], set()

    async def work(library, line):
        loop = asyncio.get_running_loop()

        def look() -> None:
            looked = threading.Event()
            loop.call_soon_threadsafe(lambda: (standing_in_library.append(station.clock.standing_now), looked.set()))
            assert looked.wait(10)

        def temperature(geocom):
            threads.add(threading.current_thread())
            look()
            response = geocom.csv.get_internal_temperature()
            look()
            return response

        assert (await library.call(temperature, 3.0)).params == 31.5

    with_library(station, work)
    assert standing_in_library == [1, 1]
    assert station.standing_at_requests == {0}
    assert threading.main_thread() not in threads
    assert station.clock.standing_now == 0


def test_every_byte_on_the_line_is_counted_stray_ones_too(station):
    async def work(library, line):
        station.plan[TEMPERATURE] = [station.doubled]
        for _ in range(3):
            await library.call(lambda geocom: geocom.csv.get_internal_temperature(), 3.0)
        await library.call(lambda geocom: geocom.com.nullprocess(), 3.0)
        counted = station.clock.counted
        assert (counted.written, counted.was_read) == (station.received, station.sent)
        assert line.counts.stray == 1

    with_library(station, work)
    assert station.clock.counted.closed


def test_a_request_times_out_in_the_cells_time(station):
    async def work(library, line):
        station.plan[TEMPERATURE] = [station.missing]
        before = station.clock.time_ns
        response = await library.call(lambda geocom: geocom.csv.get_internal_temperature(), 12.5)
        assert int(response.error) == 3077
        assert station.clock.time_ns - before == 12_500_000_000

    with_library(station, work)


def test_a_cancelled_call_frees_its_thread_for_the_next(station):
    async def work(library, line):
        station.plan[TEMPERATURE] = [lambda _number, _line: None]
        call = asyncio.create_task(library.call(lambda geocom: geocom.csv.get_internal_temperature(), 3.0))
        while not station.requests:
            await asyncio.sleep(0.001)
        call.cancel()
        with pytest.raises(asyncio.CancelledError):
            await call
        response = await library.call(lambda geocom: geocom.csv.get_internal_temperature(), 3.0)
        assert response.params == 31.5

    with_library(station, work)


def test_a_session_begins_with_another_transaction_number_than_the_last(station):
    async def work(library, line):
        await library.call(lambda geocom: geocom.com.nullprocess(), 3.0)

    with_library(station, work)
    station.clock.time_ns += 60_000_000_000
    with_library(station, work)
    first, second = (line.split(b",")[2] for line in station.raw if b"%R1Q" in line)
    assert first != second


def test_a_port_that_is_lost_while_the_library_waits_is_a_lost_device(station):
    async def work(library, line):
        station.plan[TEMPERATURE] = [lambda _number, _line: station.hang_up()]
        with pytest.raises(DeviceLost):
            await library.call(lambda geocom: geocom.csv.get_internal_temperature(), 3.0)

    with_library(station, work)
