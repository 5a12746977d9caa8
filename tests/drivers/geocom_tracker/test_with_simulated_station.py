"""The driver with the simulated laser station, over a pseudo terminal and in lockstep."""

from __future__ import annotations

import asyncio
import math
from dataclasses import astuple
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from cellctl.devices import (
    DeviceBusy,
    DeviceLost,
    Lock,
    NotLevelled,
    PointSource,
    Reflector,
    Surroundings,
    TargetLost,
    Weather,
)
from cellctl.devices.cell import Cell
from cellctl.devices.registry import DriverRegistry
from cellctl.operations.cell_devices import SimulatedCell

ROOT = Path(__file__).parents[3]
NESTS = {"N1": (1000.0, 2000.0, -300.0), "N2": (-1500.0, 2500.0, 200.0), "N3": (800.0, -2200.0, 500.0)}
"""In the instrument's frame, which is parallel to the base's; the arm is apart from them."""
STATION = (3000.0, -3000.0, 1000.0)
CERTIFIED_MM = {pair: math.dist(NESTS[pair[0]], NESTS[pair[1]]) for pair in combinations(NESTS, 2)}
WORKSHOP = Weather(20.0, 1013.25, 50.0)
CONSTANT_MM = -16.9

CELL = f"""
name: station
model: {ROOT}/procedures/robots/kr5_r1400.yaml
devices:
  tracker: geocom+serial:///dev/ttyUSB0?baud=115200&accuracy=ACCURACY
station:
  xyz: {list(STATION)}
  abc: [0, 0, 0]
  nests: NESTS
  distances: DISTANCES
reflectors:
  constant_mm: {CONSTANT_MM}
  on_flange: [{{id: R1, xyz: [120, 0, 60], facing: [1, 0, 0]}}]
postures: {{home: [0, -90, 90, 0, 45, 0]}}
simulate:
  seed: 1
  clock: lockstep
"""


def cell_file(folder: Path, accuracy: str, settings: str) -> Path:
    nests = [{"id": name, "xyz": [a + b for a, b in zip(at, STATION, strict=True)]} for name, at in NESTS.items()]
    distances = [{"between": list(pair), "mm": round(mm, 4), "sigma": 0.001} for pair, mm in CERTIFIED_MM.items()]
    text = CELL.replace("ACCURACY", accuracy).replace("NESTS", str(nests)).replace("DISTANCES", str(distances))
    path = folder / "cell.yaml"
    path.write_text(text + (f"  tracker: {{{settings}}}\n" if settings else ""))
    return path


@pytest.fixture
def at_station(tmp_path):
    """Run a coroutine function with a tracker that is set up, its simulated cell and clock."""

    def run(work, *, accuracy: str = "tdra6000", settings: str = "", seed: int = 1, constant_mm: float = CONSTANT_MM):
        async def session():
            registry = DriverRegistry()
            cell = Cell.load(cell_file(tmp_path, accuracy, settings), registry)
            simulated = await SimulatedCell.start(cell, seed, None)
            clock = await simulated.clock()
            address = simulated.address("tracker")
            tracker = registry.driver(address.scheme).open("tracker", address, Surroundings(clock, tmp_path))
            try:
                async with asyncio.timeout(120):
                    assert (await tracker.connect()).simulated
                    await tracker.initialise(Reflector(constant_mm, centring_mm=0.0))
                    await tracker.set_weather(WORKSHOP)
                    return await work(tracker, simulated, clock)
            finally:
                await tracker.close()
                await clock.aclose()
                simulated.stop()

        return asyncio.run(session())

    return run


async def all_nests(tracker: PointSource, samples: int = 3, faces: int = 2):
    points = {}
    for name, place in NESTS.items():
        await tracker.aim(place, 40.0)
        points[name] = await tracker.measure(samples, faces=faces)
    return points


@pytest.mark.parametrize("accuracy", ["tdra6000", "at960", "vantage"])
def test_distances_between_nests_are_the_certified_ones_within_the_stated_sigma(at_station, accuracy):
    async def work(tracker, _simulated, _clock):
        points = await all_nests(tracker)
        for (one, other), certified in CERTIFIED_MM.items():
            a, b = points[one], points[other]
            along = np.subtract(a.xyz, b.xyz) / math.dist(a.xyz, b.xyz)
            variance = along @ (np.array(a.covariance) + np.array(b.covariance)) @ along
            assert abs(math.dist(a.xyz, b.xyz) - certified) < 4 * math.sqrt(variance)
        assert all(point.levelled and point.weather == WORKSHOP for point in points.values())
        assert {point.noise_only for point in points.values()} == {accuracy != "tdra6000"}

    at_station(work, accuracy=accuracy)


def test_the_same_seed_gives_the_same_points_to_the_byte_and_another_seed_others(at_station):
    async def work(tracker, _simulated, clock):
        points = await all_nests(tracker, samples=2, faces=1)
        health = await tracker.health()
        return repr([astuple(point) for point in points.values()]), clock.now_ns(), repr(health)

    first, second, other = at_station(work), at_station(work), at_station(work, seed=2)
    assert first == second
    assert first[0] != other[0]


def test_the_two_face_error_is_what_the_station_was_given(at_station):
    async def work(tracker, _simulated, _clock):
        await tracker.aim(NESTS["N1"], 40.0)
        found = await tracker.two_face_error(2)
        one, two = await tracker.measure(2), await tracker.measure(2, faces=2)
        assert found.hz_rad * math.sin(one.v_rad) == pytest.approx(math.radians(5 / 3600), rel=0.02)
        assert found.v_rad == pytest.approx(math.radians(8 / 3600), rel=0.02)
        off = np.subtract(one.xyz, two.xyz)
        assert np.linalg.norm(off) == pytest.approx(math.hypot(found.hz_mm, found.v_mm), rel=0.05)

    at_station(work, settings="noise_scale: 0, collimation_arcsec: 5, index_arcsec: 8")


def test_a_wrong_constant_of_the_reflector_is_in_every_distance(at_station):
    async def work(tracker, _simulated, _clock):
        await tracker.aim(NESTS["N1"], 40.0)
        right = await tracker.measure(1)
        await tracker.initialise(Reflector(CONSTANT_MM + 2.0, centring_mm=0.0))
        await tracker.aim(NESTS["N1"], 40.0)
        assert (await tracker.measure(1)).range_mm - right.range_mm == pytest.approx(2.0, abs=0.002)

    at_station(work, settings="noise_scale: 0")


def test_wrong_air_changes_distances_by_one_ppm_per_kelvin(at_station):
    async def work(tracker, _simulated, _clock):
        await tracker.aim(NESTS["N3"], 40.0)
        right = await tracker.measure(1)
        await tracker.set_weather(Weather(50.0, 1013.25, 50.0))
        wrong = await tracker.measure(1)
        assert wrong.range_mm / right.range_mm - 1 == pytest.approx(26e-6, abs=5e-6)

    at_station(work, settings="noise_scale: 0")


def test_the_samples_of_a_point_scatter_as_stated(at_station):
    async def work(tracker, _simulated, _clock):
        await tracker.aim(NESTS["N1"], 40.0)
        point = await tracker.measure(30)
        assert point.scatter[0] == pytest.approx(0.12, rel=0.4)  # 3 σ of a standard deviation from 30
        across = math.radians(0.5 / 3600) * point.range_mm
        assert point.scatter[1] == pytest.approx(across, rel=0.4)
        assert point.scatter[2] == pytest.approx(across, rel=0.4)

    at_station(work)


def test_a_disturbed_line_delays_a_campaign_and_does_not_end_it(at_station):
    async def work(tracker, simulated, _clock):
        quiet = await all_nests(tracker, samples=1, faces=1)
        await simulated.tell({"op": "fault", "fault": "tracker.garbled", "every": 11})
        await simulated.tell({"op": "fault", "fault": "tracker.doubled", "for_ms": 20_000})
        disturbed = await all_nests(tracker, samples=1, faces=2)
        for name, point in disturbed.items():
            assert math.dist(point.xyz, quiet[name].xyz) < 2.0
        figures = (await tracker.health()).figures
        assert figures["garbled_lines"] > 0
        assert figures["stray_lines"] > 0

    at_station(work)


def test_late_and_missing_replies_are_borne_for_a_while_and_then_the_device_is_lost(at_station):
    async def work(tracker, simulated, clock):
        await tracker.aim(NESTS["N1"], 40.0)
        await simulated.tell({"op": "fault", "fault": "tracker.late", "for_ms": 4000})
        assert (await tracker.measure(2)).samples == 2
        await simulated.tell({"op": "fault", "fault": "tracker.missing", "for_ms": 4000})
        assert await tracker.lock() is Lock.LOCKED
        await simulated.tell({"op": "fault", "fault": "tracker.missing"})
        before = clock.now()
        with pytest.raises(DeviceLost):
            await tracker.lock()
        assert clock.now() - before < 20.0

    at_station(work)


def test_a_beam_that_is_broken_for_a_second_is_waited_for(at_station):
    async def work(tracker, simulated, _clock):
        await tracker.aim(NESTS["N1"], 40.0)
        await simulated.tell({"op": "fault", "fault": "tracker.beam_broken", "for_ms": 1000})
        assert (await tracker.measure(2)).samples == 2

    at_station(work)


def test_a_beam_that_stays_broken_is_a_lost_target_until_it_is_free_and_aimed_again(at_station):
    async def work(tracker, simulated, clock):
        await tracker.aim(NESTS["N1"], 40.0)
        await simulated.tell({"op": "fault", "fault": "tracker.beam_broken", "for_ms": 60_000})
        with pytest.raises(TargetLost):
            await tracker.measure(2)
        assert await tracker.lock() is Lock.NONE
        with pytest.raises(TargetLost):
            await tracker.aim(NESTS["N1"], 40.0)
        await clock.sleep(60.0)
        await tracker.aim(NESTS["N1"], 40.0)
        assert (await tracker.measure(2)).samples == 2

    at_station(work)


def test_two_reflectors_in_the_window_are_a_lost_target(at_station):
    async def work(tracker, simulated, _clock):
        await simulated.tell({"op": "fault", "fault": "tracker.second_target", "beside_mm": 15})
        with pytest.raises(TargetLost, match="several"):
            await tracker.aim(NESTS["N1"], 40.0)

    at_station(work)


def test_a_busy_instrument_is_waited_for_within_a_bound(at_station):
    async def work(tracker, simulated, _clock):
        await simulated.tell({"op": "fault", "fault": "tracker.busy", "for_ms": 5000})
        await tracker.aim(NESTS["N1"], 40.0)
        await simulated.tell({"op": "fault", "fault": "tracker.busy", "for_ms": 60_000})
        with pytest.raises(DeviceBusy):
            await tracker.measure(1)

    at_station(work)


def test_a_sleeping_instrument_is_woken_and_aimed(at_station):
    async def work(tracker, simulated, _clock):
        await simulated.tell({"op": "fault", "fault": "tracker.sleep"})
        await tracker.aim(NESTS["N1"], 40.0)
        assert (await tracker.measure(1)).weather == WORKSHOP
        assert (await tracker.health()).figures["woken"] == 1

    at_station(work)


def test_an_instrument_that_fell_asleep_after_aiming_goes_on_with_the_same_reflector(at_station):
    async def work(tracker, simulated, _clock):
        await tracker.aim(NESTS["N1"], 40.0)
        before = await tracker.measure(1)
        await simulated.tell({"op": "fault", "fault": "tracker.sleep"})
        after = await tracker.measure(1)
        assert await tracker.lock() is Lock.LOCKED
        assert math.dist(after.xyz, before.xyz) < 2.0

    at_station(work)


def test_a_tilted_instrument_is_not_levelled_and_marks_its_points(at_station):
    async def work(tracker, simulated, _clock):
        assert await tracker.levelled() is True
        await simulated.tell({"op": "fault", "fault": "tracker.tilt"})
        with pytest.raises(NotLevelled):
            await tracker.levelled()
        await tracker.aim(NESTS["N1"], 60.0)
        point = await tracker.measure(1)
        assert not point.levelled
        assert "1283" in point.warnings[0]

    at_station(work)


def test_stopping_interrupts_a_turn_of_the_telescope(at_station):
    async def work(tracker, _simulated, clock):
        await tracker.aim(NESTS["N1"], 40.0)
        turning = asyncio.create_task(tracker.aim(NESTS["N3"], 40.0))
        await clock.sleep(0.5)
        before = clock.now()
        await tracker.stop()
        with pytest.raises(Exception, match="interrupted"):
            await turning
        assert clock.now() - before < 0.5
        await tracker.aim(NESTS["N3"], 40.0)

    at_station(work)
