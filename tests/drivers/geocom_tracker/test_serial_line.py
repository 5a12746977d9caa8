"""A disturbed serial line: reads are repeated, motions and measurements are not repeated blindly."""

from __future__ import annotations

import asyncio

import pytest

from cellctl.clock import WallClock
from cellctl.devices import Address, DeviceLost, DeviceRefused, DeviceUnreachable, Surroundings
from drivers.geocom_tracker.description import open_tracker
from tests.helpers.station import CHANGE_FACE, FINE, FULL, MEASURE, NULL, TEMPERATURE, TURN, crc_16_arc, tracker_at

DISTURBANCES = [
    "missing",
    "comes_late",
    "doubled",
    "garbled",
    "wrong_check_sum",
    "one_wrong_digit",
    "other_transaction",
    "without_check_sum",
    "not_heard",
]
LOSES_THE_ANSWER = [one for one in DISTURBANCES if one not in ("doubled", "not_heard")]
PLACE = (1000.0, 2000.0, 300.0)


def test_the_check_sum_of_this_script_is_crc_16_arc():
    assert crc_16_arc(b"123456789") == 0xBB3D


@pytest.mark.parametrize("disturbance", DISTURBANCES)
def test_a_read_survives_a_disturbed_answer(station, run, disturbance):
    async def work(tracker):
        station.plan[TEMPERATURE] = [getattr(station, disturbance)]
        health = await tracker.health()
        assert health.figures["internal_c"] == 31.5
        again = await tracker.health()
        assert (again.figures["internal_c"], again.figures["power_percent"]) == (31.5, 80)

    run(work)


@pytest.mark.parametrize("disturbance", LOSES_THE_ANSWER)
def test_an_instrument_that_never_answers_properly_is_lost(station, run, disturbance):
    async def work(tracker):
        station.plan[TEMPERATURE] = [getattr(station, disturbance)] * 3
        with pytest.raises(DeviceLost, match="3 times") as caught:
            await tracker.health()
        assert "baud" in caught.value.cure

    run(work)


@pytest.mark.parametrize("disturbance", LOSES_THE_ANSWER)
@pytest.mark.parametrize("rpc", [TURN, FINE])
def test_a_motion_with_a_lost_answer_is_begun_again_after_the_instrument_answered(station, run, rpc, disturbance):
    async def work(tracker):
        station.plan[rpc] = [getattr(station, disturbance)]
        await tracker.aim(PLACE, 40.0)
        asked = station.asked()
        lost = asked.index(rpc)
        assert asked[lost + 1 : lost + 3] == [NULL, TURN]

    run(work)


def test_a_motion_whose_answer_is_lost_three_times_is_a_lost_device(station, run):
    async def work(tracker):
        station.plan[TURN] = [station.missing] * 3
        with pytest.raises(DeviceLost):
            await tracker.aim(PLACE, 40.0)
        assert station.asked().count(TURN) == 3

    run(work)


@pytest.mark.parametrize("disturbance", LOSES_THE_ANSWER)
def test_a_measurement_with_a_lost_answer_is_cleared_before_it_is_begun_again(station, run, disturbance):
    async def work(tracker):
        station.plan[FULL] = [getattr(station, disturbance)]
        point = await tracker.measure(1)
        assert point.samples == 1
        assert point.range_mm == pytest.approx(3000.0)
        asked = [(rpc, params[0] if params else "") for rpc, params in station.requests]
        lost = next(index for index, (rpc, _) in enumerate(asked) if rpc == FULL)
        assert asked[lost + 1 : lost + 4] == [(NULL, ""), (MEASURE, "3"), (MEASURE, "1")]

    run(work)


@pytest.mark.parametrize("disturbance", LOSES_THE_ANSWER)
def test_the_face_is_not_changed_again_when_only_the_answer_is_lost(station, run, disturbance):
    async def work(tracker):
        station.plan[CHANGE_FACE] = [getattr(station, disturbance)]
        point = await tracker.measure(1, faces=2)
        assert point.faces == 2
        assert station.asked().count(CHANGE_FACE) == 2  # there and back
        assert station.face == 1

    run(work)


def test_a_request_that_was_not_heard_is_repeated_even_if_it_moves(station, run):
    async def work(tracker):
        station.plan[TURN] = [station.not_heard]
        await tracker.aim(PLACE, 40.0)
        assert station.asked()[:3] == [TURN, TURN, FINE]

    run(work)


def test_after_a_disturbance_a_line_feed_empties_the_instruments_buffer(station, run):
    async def work(tracker):
        station.plan[TEMPERATURE] = [station.missing]
        await tracker.health()
        after = next(i for i, line in enumerate(station.raw) if b"Q,5011," in line) + 1
        assert station.raw[after].startswith(b"\n%R1Q,5011,")

    run(work)


def test_a_line_without_end_is_discarded(station, run):
    async def work(tracker):
        station.send(b"\xff" * 3000)
        await asyncio.sleep(0)
        health = await tracker.health()
        assert health.ok

    run(work)


def test_a_lost_port_is_a_lost_device(station, run):
    async def work(tracker):
        station.hang_up()
        with pytest.raises(DeviceLost, match="port"):
            await tracker.health()
        with pytest.raises(DeviceLost):
            await tracker.lock()

    run(work)


def test_a_port_that_is_lost_during_a_motion_ends_it_at_once(station, run):
    async def work(tracker):
        station.plan[TURN] = [lambda _number, _line: station.hang_up()]
        before = station.clock.time_ns
        with pytest.raises(DeviceLost, match="port"):
            await tracker.aim(PLACE, 40.0)
        assert station.clock.time_ns == before

    run(work)


def test_an_instrument_that_does_not_answer_is_unreachable(station):
    async def session():
        station.listen()
        station.plan[NULL] = [station.missing] * 3
        with pytest.raises(DeviceUnreachable, match=r"did not answer in time .*3 times"):
            await tracker_at(station).connect()

    asyncio.run(session())


def test_a_missing_port_is_unreachable_with_its_cure():
    tracker = open_tracker(
        "tracker", Address.parse("geocom+serial:///dev/tty-that-is-not-there"), Surroundings(WallClock(), None)
    )
    with pytest.raises(DeviceUnreachable, match="ENOENT"):
        asyncio.run(tracker.connect())


@pytest.mark.parametrize(
    ("address", "words"),
    [
        ("geocom+serial://host/dev/ttyUSB0", "three slashes"),
        ("geocom+serial:///dev/ttyUSB0?baud=x", "baud"),
        ("geocom+serial:///dev/ttyUSB0?parity=even", "accuracy, baud"),
        ("geocom+serial:///dev/ttyUSB0?accuracy=best", "tdra6000, at960, vantage"),
    ],
)
def test_an_address_with_an_error_is_refused_before_anything_is_opened(address, words):
    with pytest.raises(ValueError, match=words):
        open_tracker("tracker", Address.parse(address), Surroundings(WallClock(), None))


def test_a_cancelled_motion_is_interrupted_and_the_next_request_works(station, run):
    async def work(tracker):
        station.plan[TURN] = [lambda _number, _line: None]
        moving = asyncio.create_task(tracker.aim(PLACE, 40.0))
        while TURN not in station.asked():
            await asyncio.sleep(0.001)
        moving.cancel()
        with pytest.raises(asyncio.CancelledError):
            await moving
        station.plan[TURN] = [lambda _number, line: station.send(b"?\r\n" + line)]  # the abort's answer comes late
        await tracker.aim(PLACE, 40.0)
        assert b"c" in [line.strip() for line in station.raw]

    run(work)


@pytest.mark.parametrize("answered", [False, True])
def test_stop_interrupts_a_motion_in_progress_and_nothing_else(station, run, answered):
    """The interrupted request may get an answer of its own after the abort's, or none."""

    async def work(tracker):
        await tracker.stop()
        assert b"c" not in station.raw
        number_of = []
        station.plan[TURN] = [lambda number, _line: number_of.append(number)]
        moving = asyncio.create_task(tracker.aim(PLACE, 40.0))
        while not number_of:
            await asyncio.sleep(0.001)
        await tracker.stop()
        station.send(b"?\r\n")
        if answered:
            station.send_answer(number_of[0], 8)
        with pytest.raises(DeviceRefused, match="interrupted"):
            await moving
        assert (await tracker.health()).ok
        assert b"c" in station.raw

    run(work)


def test_requests_from_several_tasks_go_one_after_another(station, run):
    async def work(tracker):
        in_flight = []
        waiting = []

        def hold(number, line):
            in_flight.append(number)
            waiting.append(line)

        station.plan[TEMPERATURE] = [hold]
        first, second = asyncio.create_task(tracker.health()), asyncio.create_task(tracker.lock())
        while not waiting:
            await asyncio.sleep(0.001)
        await asyncio.sleep(0.01)
        count = len(station.requests)
        await asyncio.sleep(0.01)
        assert len(station.requests) == count
        station.send(waiting[0])
        await asyncio.gather(first, second)

    run(work)
