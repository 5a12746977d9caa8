"""What a campaign relies on: points, faces, warnings, a lost reflector, a busy or sleeping instrument."""

from __future__ import annotations

import math

import pytest

from cellctl.devices import (
    DeviceBusy,
    DeviceFault,
    DeviceLost,
    DeviceRefused,
    LimitExceeded,
    Lock,
    NotLevelled,
    PointSource,
    Reflector,
    TargetLost,
    Weather,
)
from tests.helpers.station import (
    ATMOSPHERE,
    CHANGE_FACE,
    FINE,
    FULL,
    INCLINED,
    LOCK_IN,
    LOCK_STATE,
    MEASURE,
    NULL,
    POWER,
    SET_ATMOSPHERE,
    TURN,
    WAKE,
)

PLACE = (1000.0, 2000.0, 300.0)
WORKSHOP = Weather(temperature_c=22.5, pressure_hpa=1005.0, humidity_percent=45.0)


def test_the_tracker_is_a_point_source(station, run):
    async def work(tracker):
        assert isinstance(tracker, PointSource)

    run(work)


def test_the_identity_is_the_instruments_own(station, run):
    async def work(tracker):
        identity = await tracker.connect()
        assert (identity.serial, identity.model, identity.simulated) == ("360123", "SIM-TDRA6000", True)
        assert identity.firmware == "4.20.0, GeoCOM 1.50.3"
        station.name = '"TDRA6000"'
        assert not (await tracker.connect()).simulated

    run(work)


def test_initialising_writes_the_reflectors_constant_in_metres(station, run):
    async def work(tracker):
        await tracker.initialise(Reflector(constant_mm=-16.9))
        assert float(station.constant) == pytest.approx(-0.0169)

    run(work)


def test_a_reflectors_constant_that_was_not_taken_is_refused(station, run):
    async def work(tracker):
        station.plan[17033] = [lambda number, _line: station.send_answer(number, 0, 0.0344, 1, '"x"')]
        with pytest.raises(DeviceRefused, match=r"34\.4 mm"):
            await tracker.initialise(Reflector(constant_mm=-16.9))

    run(work)


def test_older_firmware_is_initialised_by_its_own_requests(station, run):
    async def work(tracker):
        station.codes[18005], station.codes[18007], station.codes[17019] = [5], [5], [2]
        await tracker.initialise(Reflector(constant_mm=0.0))
        asked = station.asked()
        assert asked.index(9018) < asked.index(9020)
        assert [params for rpc, params in station.requests if rpc == 17019] == [["11"], ["0"]]

    run(work)


def test_a_new_connection_must_be_initialised_again(station, run):
    async def work(tracker):
        await tracker.set_weather(WORKSHOP)
        await tracker.connect()
        with pytest.raises(DeviceRefused, match="not initialised"):
            await tracker.measure(1)
        await tracker.initialise(Reflector(constant_mm=0.0))
        assert (await tracker.measure(1)).weather is None

    run(work)


def test_measuring_before_initialising_is_refused(station, run):
    async def work(tracker):
        with pytest.raises(DeviceRefused, match="not initialised"):
            await tracker.measure(1)

    run(work, initialised=False)


def test_a_tracker_that_is_not_connected_is_lost_with_its_cure(station, run):
    async def work(tracker):
        await tracker.close()
        with pytest.raises(DeviceLost, match="connect it first"):
            await tracker.measure(1)

    run(work)


def test_weather_is_written_and_the_wavelength_stays_as_it_is(station, run):
    async def work(tracker):
        await tracker.set_weather(WORKSHOP)
        wavelength, pressure, dry, wet = map(float, station.atmosphere)
        assert (wavelength, pressure, dry) == (6.58e-7, 1005.0, 22.5)
        assert wet == pytest.approx(15.1, abs=0.1)  # psychrometric table: 22.5 °C, 45 %
        assert (await tracker.measure(1)).weather == WORKSHOP

    run(work)


@pytest.mark.parametrize(
    "weather", [Weather(-99.0, 1000.0, 50.0), Weather(20.0, 1.0, 50.0), Weather(20.0, 1000.0, math.nan)]
)
def test_impossible_weather_is_not_written(station, run, weather):
    async def work(tracker):
        with pytest.raises(LimitExceeded, match="outside"):
            await tracker.set_weather(weather)
        assert SET_ATMOSPHERE not in station.asked()

    run(work)


def test_aiming_turns_to_the_place_and_searches_the_window_at_its_distance(station, run):
    async def work(tracker):
        await tracker.aim((0.0, 3000.0, 4000.0), 50.0)
        (_, turn), (_, fine) = station.requests[:2]
        assert list(map(float, turn[:2])) == pytest.approx([0.0, math.acos(0.8)], abs=1e-6)
        assert list(map(float, fine[:2])) == pytest.approx([2 * 50 / 3000, 2 * 50 / 5000], rel=1e-3)
        assert station.asked() == [TURN, FINE, LOCK_IN, LOCK_STATE]

    run(work)


def test_a_search_wider_than_the_distance_is_not_sent(station, run):
    async def work(tracker):
        with pytest.raises(LimitExceeded):
            await tracker.aim((0.0, 30.0, 0.0), 40.0)
        assert not station.requests

    run(work)


def test_a_lock_that_does_not_hold_is_a_lost_target(station, run):
    async def work(tracker):
        station.lock_state = 0
        with pytest.raises(TargetLost):
            await tracker.aim(PLACE, 40.0)

    run(work)


@pytest.mark.parametrize(("number", "lock"), [(0, Lock.NONE), (1, Lock.LOCKED), (2, Lock.PREDICTED)])
def test_the_lock_is_read(station, run, number, lock):
    async def work(tracker):
        station.lock_state = number
        assert await tracker.lock() is lock

    run(work)


def test_a_point_is_in_the_instruments_frame(station, run):
    async def work(tracker):
        await tracker.aim(PLACE, 40.0)
        station.metres = math.hypot(*PLACE) / 1000
        point = await tracker.measure(3)
        assert point.xyz == pytest.approx(PLACE, abs=0.01)  # geocompy sends angles with six decimals
        assert (point.samples, point.faces, point.device_ms) == (3, 1, 4711)
        assert (point.accuracy, point.noise_only, point.levelled, point.warnings) == ("tdra6000", False, True, ())

    run(work)


def test_two_faces_remove_collimation_and_index_error(station, run):
    async def work(tracker):
        await tracker.aim(PLACE, 40.0)
        station.metres = math.hypot(*PLACE) / 1000
        station.collimation, station.index = 2e-4, -3e-4
        one, two = await tracker.measure(2), await tracker.measure(2, faces=2)
        assert math.dist(one.xyz, PLACE) > 0.5
        assert math.dist(two.xyz, PLACE) < 0.01
        assert (two.faces, two.samples) == (2, 4)

    run(work)


def test_the_two_face_error_is_collimation_and_index_error(station, run):
    async def work(tracker):
        await tracker.aim(PLACE, 40.0)
        station.collimation, station.index = 2e-4, -3e-4
        found = await tracker.two_face_error(2)
        assert found.hz_rad == pytest.approx(2e-4, rel=1e-6)
        assert found.v_rad == pytest.approx(-3e-4, rel=1e-6)
        assert found.hz_mm == pytest.approx(2e-4 * 3000 * math.sin(station.v), rel=1e-3)
        assert found.v_mm == pytest.approx(-3e-4 * 3000, rel=1e-6)

    run(work)


def test_the_faces_alternate_so_that_a_drift_cancels_and_end_in_the_first(station, run):
    async def work(tracker):
        await tracker.aim(PLACE, 40.0)
        station.requests.clear()
        await tracker.measure(4, faces=2)
        order = [rpc for rpc in station.asked() if rpc in (CHANGE_FACE, FULL)]
        assert order == [FULL] * 2 + [CHANGE_FACE] + [FULL] * 4 + [CHANGE_FACE] + [FULL] * 2
        await tracker.measure(1, faces=2)
        assert station.face == 1

    run(work)


def test_each_sample_clears_the_old_distance_before_it_measures(station, run):
    async def work(tracker):
        await tracker.measure(2)
        modes = [params[0] for rpc, params in station.requests if rpc == MEASURE]
        assert modes == ["3", "1", "3", "1"]

    run(work)


@pytest.mark.parametrize(("code", "levelled"), [(1283, False), (1284, True)])
def test_warnings_with_all_data_are_kept_with_the_point(station, run, code, levelled):
    async def work(tracker):
        station.full_code = code
        point = await tracker.measure(2)
        assert point.range_mm == pytest.approx(3000.0)
        assert len(point.warnings) == 1
        assert str(code) in point.warnings[0]
        assert point.levelled is levelled

    run(work)


@pytest.mark.parametrize("code", [1285, 1288, 1289])
def test_angles_without_a_distance_are_no_point(station, run, code):
    async def work(tracker):
        station.full_code, station.metres, station.lock_state = code, 0.0, 0
        station.lock_states = [1]
        with pytest.raises(TargetLost, match="no distance"):
            await tracker.measure(1)

    run(work)


def test_a_beam_that_is_interrupted_and_regained_is_waited_for(station, run):
    async def work(tracker):
        station.codes[FULL] = [1292]
        station.lock_states = [1, 2, 2, 2, 1]
        point = await tracker.measure(2)
        assert point.samples == 2
        assert sum(station.clock.slept) > 0

    run(work)


def test_a_reflector_that_is_lost_for_good_is_reported_and_aiming_again_succeeds(station, run):
    async def work(tracker):
        station.codes[FULL] = [1292]
        station.lock_states = [1, 2, 2, 0]
        with pytest.raises(TargetLost) as caught:
            await tracker.measure(2)
        assert "aim again" in caught.value.cure
        await tracker.aim(PLACE, 40.0)
        assert (await tracker.measure(2)).samples == 2

    run(work)


def test_waiting_for_the_beam_ends(station, run):
    async def work(tracker):
        station.codes[FULL] = [1292]
        station.lock_states, station.lock_state = [1], 2
        with pytest.raises(TargetLost):
            await tracker.measure(2)
        assert sum(station.clock.slept) == pytest.approx(3.0, abs=0.3)

    run(work)


@pytest.mark.parametrize("code", [13, 786, 1293, 1793])
def test_a_busy_instrument_is_asked_again(station, run, code):
    async def work(tracker):
        station.codes[FULL] = [code, code]
        assert (await tracker.measure(1)).samples == 1
        assert (await tracker.health()).figures["busy"] == 2

    run(work)


def test_an_instrument_that_stays_busy_is_reported_within_a_bound(station, run):
    async def work(tracker):
        station.codes[FULL] = [13] * 1000
        with pytest.raises(DeviceBusy):
            await tracker.measure(1)
        assert 5.0 < sum(station.clock.slept) < 20.0

    run(work)


def test_an_instrument_that_sleeps_is_woken_set_up_again_and_goes_on(station, run):
    async def work(tracker):
        await tracker.set_weather(WORKSHOP)
        station.asleep = True
        station.requests.clear()
        await tracker.aim(PLACE, 40.0)
        asked = station.asked()
        assert asked.index(WAKE) < asked.index(17032) < asked.index(SET_ATMOSPHERE) < len(asked) - 4
        assert asked[-4:] == [TURN, FINE, LOCK_IN, LOCK_STATE]
        assert (await tracker.health()).figures["woken"] == 1

    run(work)


def test_an_instrument_that_sleeps_can_be_connected(station, run):
    async def work(tracker):
        station.asleep = True
        assert (await tracker.connect()).model == "SIM-TDRA6000"

    run(work)


def test_an_instrument_that_does_not_wake_is_reported_within_a_bound(station, run):
    async def work(tracker):
        station.codes[NULL] = [25] * 1000
        station.asleep = True
        with pytest.raises(DeviceFault, match="asleep"):
            await tracker.aim(PLACE, 40.0)
        assert sum(station.clock.slept) < 30.0

    run(work)


def test_a_levelled_instrument_says_so_and_a_tilted_one_raises(station, run):
    async def work(tracker):
        assert await tracker.levelled() is True
        station.plan[INCLINED] = [
            lambda number, _line: station.send_answer(number, 1283, 0.1, 1.5, 1e-6, 0, 0.0, 0.0, 1e-6, 0, 0)
        ]
        with pytest.raises(NotLevelled, match="out of its range"):
            await tracker.levelled()
        station.codes[INCLINED] = [22]
        with pytest.raises(NotLevelled, match="tilted"):
            await tracker.levelled()
        station.plan[2007] = [lambda number, _line: station.send_answer(number, 0, 0)]
        assert await tracker.levelled() is False

    run(work)


def test_health_names_power_temperature_and_latency(station, run):
    async def work(tracker):
        health = await tracker.health()
        assert health.ok
        assert health.text == "battery 80 %, inside 31.5 °C"
        assert {"latency_ms", "power_percent", "internal_c", "missing_answers"} <= set(health.figures)
        station.plan[POWER] = [lambda number, _line: station.send_answer(number, 0, 4, 2, 2)]
        assert not (await tracker.health()).ok
        station.codes[POWER] = [18]
        empty = await tracker.health()
        assert (empty.ok, "empty battery" in empty.text) == (False, True)

    run(work)


@pytest.mark.parametrize("accuracy", ["at960", "vantage"])
def test_a_profile_of_an_instrument_that_does_not_speak_geocom_says_so_everywhere(station, run, accuracy):
    async def work(tracker):
        point = await tracker.measure(1)
        assert (point.accuracy, point.noise_only) == (accuracy, True)
        note = f"noise of {accuracy} only"
        assert note in (await tracker.health()).text
        assert note in (await tracker.connect()).model

    run(work, accuracy=accuracy)


@pytest.mark.parametrize(("samples", "faces"), [(0, 1), (1, 3)])
def test_a_measurement_without_samples_or_with_three_faces_is_an_error(station, run, samples, faces):
    async def work(tracker):
        with pytest.raises(ValueError, match="at least one sample"):
            await tracker.measure(samples, faces=faces)

    run(work)


def test_the_atmosphere_is_read_before_it_is_written(station, run):
    async def work(tracker):
        await tracker.set_weather(WORKSHOP)
        assert station.asked() == [ATMOSPHERE, SET_ATMOSPHERE]

    run(work)
