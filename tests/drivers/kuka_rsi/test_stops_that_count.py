"""Stops that were missed, or confirmed by nothing: against the RSI process and the tests' controller."""

import asyncio
from contextlib import suppress

import pytest

from cellctl.devices import (
    ControllerTable,
    DeviceError,
    DeviceUncertain,
    LimitExceeded,
    SearchEnd,
    TableRow,
)
from cellctl.engine import _run_devices
from drivers.kuka_rsi.cyclic.shared_block import Slot
from drivers.kuka_rsi.robot import holding

HOME = (0.0, -90.0, 90.0, 0.0, 45.0, 0.0)
TWO_DEG = (0.0, -88.0, 90.0, 0.0, 45.0, 0.0)
FAR = (0.0, -80.0, 90.0, 0.0, 45.0, 0.0)


def reached(controller, number, more=lambda cycle: None):
    """An event at the cycle `number` of a search."""
    event, loop = asyncio.Event(), asyncio.get_running_loop()

    def on_cycle(cycle):
        if cycle == number:
            loop.call_soon_threadsafe(event.set)
        more(cycle)

    controller.on_cycle = on_cycle
    return event


def set_point(controller):
    """Of A2, deg, in the last answer."""
    return controller.answers[-1].correction[1]


def test_a_cancelled_search_stops_its_set_point_although_halt_is_late(controller, connected, run):
    at_halt = []
    real = controller._halt

    def late(number):
        at_halt.append(set_point(controller))
        controller._after(1.0, lambda: real(number))

    controller._halt = late

    async def go():
        async with connected() as robot:
            begun = reached(controller, 60)
            task = asyncio.create_task(robot.search(TWO_DEG, 1.0))
            await begun.wait()
            task.cancel()
            with suppress(asyncio.CancelledError):
                await task

    run(go())
    assert 0.0 < at_halt[0] < 0.5
    assert set_point(controller) < at_halt[0] + 0.05  # half of one more step at 1 deg/s, not a second of it


def test_a_search_on_a_controller_that_says_nothing_more_stands(controller, connected, run):
    later = {}

    def silent(cycle):
        if cycle == 60:
            controller.eki_silent = True
            controller._halt = lambda number: None

    async def go():
        async with connected() as robot:
            reached(controller, 60, silent)
            with pytest.raises(DeviceUncertain, match="may still be moving"):
                await robot.search((0.0, -86.0, 90.0, 0.0, 45.0, 0.0), 1.0)
            later["then"] = set_point(controller)
            await robot._clock.sleep(0.3)
            later["now"] = set_point(controller)

    run(go())
    assert later["now"] < later["then"] + 0.005  # a step of 4 ms at most, not 0.3 s at 1 deg/s


@pytest.mark.parametrize("code", [10, 11, 12])
def test_a_refused_halt_confirms_nothing(code, controller, connected, run):
    controller.move_takes_s = 1000.0
    controller._halt = lambda number: controller._reply(number, code, "refused")

    async def go():
        async with connected() as robot:
            task = asyncio.create_task(robot.move(FAR, 10))
            await robot._clock.sleep(0.3)
            with pytest.raises(DeviceUncertain, match="has not confirmed that the robot stands"):
                await robot.stop()
            task.cancel()
            with suppress(asyncio.CancelledError, DeviceError):
                await task

    run(go())


def test_no_motion_is_begun_while_an_earlier_stop_is_not_confirmed(controller, connected, run):
    real = controller._halt

    async def go():
        async with connected() as robot:
            controller.move_takes_s = 1000.0
            controller._halt = lambda number: None
            task = asyncio.create_task(robot.move((10.0, *HOME[1:]), 10))
            await robot._clock.sleep(0.3)
            task.cancel()
            with suppress(asyncio.CancelledError, DeviceError):
                await task
            controller._moving, controller.program, controller.move_takes_s = None, "READY", 0.2
            with pytest.raises(DeviceUncertain, match="nothing was begun"):
                await robot.move((20.0, *HOME[1:]), 10)
            controller._halt = real  # it is asked once more, and confirms
            assert (await robot.move((20.0, *HOME[1:]), 10))[0] == pytest.approx(20.0)

    run(go())


@pytest.mark.parametrize("when", ["before the connection", "before a reconnection"])
def test_a_stop_outlives_the_connection(when, controller, connected, run):
    async def go():
        async with connected() as robot:
            if when == "before a reconnection":
                robot.stop_now()
            await robot.close()
            robot.stop_now()
            await robot.connect()
            controller.sends_to(robot.listening()[1])
            assert (await robot.search(TWO_DEG, 1.0)).end is SearchEnd.STOPPED
            robot.clear_stop()
            assert not robot._lines.block.words[Slot.STOP]

    run(go())


@pytest.mark.parametrize("guards", [{"probe": 0.0}, {"probe": -1.0}, {"probe": float("nan")}, {"engine": 0.0}])
def test_a_guard_of_no_time_is_refused(guards, controller, connected, run):
    async def go():
        async with connected() as robot:
            with pytest.raises(LimitExceeded, match="more than 0 s are needed"):
                await robot.search(TWO_DEG, 1.0, guards)

    run(go())


def test_the_engines_own_guard_cannot_be_weakened(controller, connected, run):
    async def go():
        async with connected() as robot:
            assert robot._guards.oldest_ns({"engine": 60.0})[0] == 250_000_000
            assert robot._guards.oldest_ns({"engine": 0.1})[0] == 100_000_000

    run(go())


def test_a_table_that_corrects_too_much_is_refused_by_the_driver(controller, connected, run):
    table = ControllerTable("abc", "SIM-000007", (TableRow(HOME, (3.0, *HOME[1:])),))

    async def go():
        async with connected() as robot:
            with pytest.raises(LimitExceeded, match=r"row 1 of table abc corrects a joint by 3\.000° \(at most 2°\)"):
                await robot.push_table(table)

    run(go())


def test_the_driver_says_that_a_stop_is_not_confirmed_before_the_engine_gives_up():
    assert holding._HALT_S < _run_devices._STOP_SECONDS
