"""Moves, searches, currents and tables of a UR by its resident program, which the simulated controller executes."""

from __future__ import annotations

import asyncio
import math

import pytest

from cellctl.devices import ControllerTable, DeviceFault, DeviceRefused, LimitExceeded, SearchEnd, TableRow
from drivers.ur_rtde.jobs import Job, Jobs, Outcome
from tests.drivers.ur_rtde.conftest import BEFORE, HOME, INSIDE

BESIDE = (HOME[0] + 1.0, *HOME[1:])
NEAR = (172.0, -55.0, 80.0, -80.0, -45.0, 50.0)


def apart(a, b):
    return max(abs(x - y) for x, y in zip(a, b, strict=True))


def test_connecting_moves_nothing_and_names_the_controller(on_wire):
    async def work(wire):
        health = await wire.robot.health()
        return wire.identity, health, await wire.robot.joints()

    identity, health, joints = on_wire(work, series="e")
    assert identity.model == "Universal Robots UR10"
    assert identity.simulated
    assert health.ok, health.text
    assert health.mode == "remote"
    assert apart(joints, HOME) < 1e-3


def test_a_move_arrives_where_it_was_sent_and_no_faster_than_asked(on_wire):
    async def work(wire):
        begun = wire.clock.now()
        reached = await wire.robot.move(NEAR, 10)
        return reached, wire.clock.now() - begun

    reached, seconds = on_wire(work)
    assert apart(reached, NEAR) < 0.01
    assert seconds > apart(HOME, NEAR) / 12.0


@pytest.mark.parametrize(
    ("order", "says"),
    [
        (lambda robot: robot.move(NEAR, 60), "speed 60 % is not within 0 … 50 %"),
        (lambda robot: robot.move((400.0, *NEAR[1:]), 10), "A1 400.000 deg is outside ±363 deg"),
        (lambda robot: robot.move((math.nan, *NEAR[1:]), 10), "are not 6 joint readings"),
        (lambda robot: robot.search(NEAR, 1.0), "deg is not within 0 … 5 deg"),
        (lambda robot: robot.search(INSIDE, 3.0), "speed 3 deg/s is not within 0 … 2.5"),
    ],
)
def test_what_is_over_a_limit_moves_nothing(on_wire, order, says):
    async def work(wire):
        home = await wire.robot.move(HOME, 30)
        with pytest.raises(LimitExceeded) as error:
            await order(wire.robot)
        return str(error.value), apart(await wire.robot.joints(), home)

    text, moved = on_wire(work)
    assert says in text
    assert moved < 1e-3


@pytest.mark.parametrize(
    ("job", "outcome"),
    [
        (Job(1, NEAR, 1.1), Outcome.TOO_FAST),
        (Job(2, BESIDE, 0.05), Outcome.TOO_FAST),
        (Job(1, NEAR, 0.0), Outcome.TOO_FAST),
        (Job(1, NEAR, -0.1), Outcome.TOO_FAST),
        (Job(2, (HOME[0] + 6.0, *HOME[1:]), 0.02), Outcome.TOO_FAR),
        (Job(3, NEAR, 0.1), Outcome.KIND),
        (Job(-1, NEAR, 0.1), Outcome.KIND),
    ],
)
def test_the_program_itself_refuses_what_is_over_its_limits(on_wire, job, outcome):
    async def work(wire):
        jobs = Jobs("robot", wire.clock, wire.robot._line, wire.robot._digest)
        await jobs.open()
        last = await jobs.run(job, 50.0, 10.0, lambda _: None, lambda: None)
        return last.outcome, last.joints

    found, joints = on_wire(work)
    assert found == outcome
    assert apart(joints, HOME) < 1e-3


async def searched(wire, speed=0.6):
    await wire.robot.move(BEFORE, 30)
    wire.robot.clear_stop()
    return await wire.robot.search(INSIDE, speed)


def test_a_search_stops_at_a_contact_by_the_wire_at_the_controller_s_input(on_wire):
    found = on_wire(searched, series="e")
    assert found.end is SearchEnd.STOPPED
    assert 0.2 < math.dist(found.joints[0], found.resting) < math.dist(BEFORE, INSIDE) - 0.2
    assert apart(found.joints[0], BEFORE) < 0.01
    assert 0 < found.stop_cycles < 100
    steps = {round((b - a) / 1e6) for a, b in zip(found.times_ns, found.times_ns[1:], strict=False)}
    assert steps == {2}


def test_a_search_goes_to_its_end_without_contact(on_wire):
    async def work(wire):
        return await wire.robot.search(BESIDE, 2.0)

    found = on_wire(work)
    assert found.end is SearchEnd.TRAVEL
    assert abs(found.resting[0] - HOME[0] - 1.0) < 0.1
    assert found.stop_cycles == 0


def test_health_states_latency_and_after_a_search_how_the_controller_s_clock_was_fitted(on_wire):
    async def work(wire):
        before = (await wire.robot.health()).figures
        found = await wire.robot.search(BESIDE, 2.0)
        return before, (await wire.robot.health()).figures, found

    before, after, found = on_wire(work, series="cb3")
    assert before["latency_ms"] >= 0.0
    assert "clock_sigma_ms" not in before
    assert 0.0 <= after["clock_sigma_ms"] < 8.0, "a mapped instant is within the controller's cycle"
    assert abs(after["clock_drift_ppm"]) < 1e4
    assert len(found.times_ns) > 50


def test_a_search_stops_at_the_host_s_message(on_wire):
    async def work(wire):
        wire.clock.call_later(0.5, wire.robot.stop_now)
        found = await wire.robot.search((HOME[0] + 3.0, *HOME[1:]), 2.0)
        again = await wire.robot.search((found.resting[0] + 3.0, *HOME[1:]), 2.0)
        wire.robot.clear_stop()
        last = await wire.robot.search((found.resting[0] + 1.0, *HOME[1:]), 2.0)
        return found, again, last

    found, again, last = on_wire(work, query="")
    assert found.end is SearchEnd.STOPPED
    assert 0.5 < found.resting[0] - HOME[0] < 1.6
    assert again.end is SearchEnd.STOPPED
    assert apart(again.resting, found.resting) < 1e-3
    assert last.end is SearchEnd.TRAVEL


def test_a_guard_that_is_too_old_holds_the_robot_and_names_the_device(on_wire):
    async def work(wire):
        wire.robot.guard("probe").beat(wire.clock.now_ns())
        with pytest.raises(Exception, match=r"probe: no sign of life for 0\.[0-9]+ s"):
            await wire.robot.search((HOME[0] + 3.0, *HOME[1:]), 2.0, {"probe": 0.2})
        return await wire.robot.joints(), await wire.stands()

    joints, stands = on_wire(work)
    assert 0.1 < joints[0] - HOME[0] < 1.5
    assert stands


def test_cancelling_a_move_stops_the_robot(on_wire):
    async def work(wire):
        task = asyncio.create_task(wire.robot.move(NEAR, 2))
        await wire.clock.sleep(1.0)
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
        return await wire.robot.joints(), await wire.stands()

    joints, stands = on_wire(work)
    assert 0.5 < apart(joints, HOME) < apart(NEAR, HOME) - 0.5
    assert stands


def test_a_stop_ends_a_move_and_the_next_one_goes_on(on_wire):
    async def work(wire):
        task = asyncio.create_task(wire.robot.move(NEAR, 2))
        await wire.clock.sleep(1.0)
        await wire.robot.stop()
        with pytest.raises(DeviceFault, match="move: stopped"):
            await task
        return await wire.stands(), await wire.robot.move(NEAR, 30)

    stands, reached = on_wire(work)
    assert stands
    assert apart(reached, NEAR) < 0.01


def test_joints_and_health_are_read_while_the_robot_moves(on_wire):
    async def work(wire):
        task = asyncio.create_task(wire.robot.move(NEAR, 2))
        seen = []
        while not task.done():
            await wire.clock.sleep(0.5)
            seen.append((await wire.robot.joints(), (await wire.robot.health()).ok))
        return seen, await task

    seen, reached = on_wire(work)
    assert all(ok for _, ok in seen)
    assert apart(reached, NEAR) < 0.01
    assert 0.5 < apart(seen[1][0], HOME) < apart(NEAR, HOME) - 0.5


def test_a_reading_that_is_cancelled_at_any_moment_leaves_the_line_in_order(on_wire):
    async def work(wire):
        for turns in range(12):
            task = asyncio.create_task(wire.robot.health())
            for _ in range(turns):
                await wire.clock.sleep(0.003)
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)
        return (await wire.robot.health()).ok, await wire.robot.move(NEAR, 30)

    ok, reached = on_wire(work)
    assert ok
    assert apart(reached, NEAR) < 0.01


def test_currents_are_the_mean_of_so_many_samples(on_wire):
    async def work(wire):
        return await wire.robot.currents(200)

    found = on_wire(work)
    assert found.samples == 200
    assert max(map(abs, found.amperes)) > 0.5
    assert all(0.01 < sigma < 0.04 for sigma in found.sigma_a)


def test_a_table_is_held_by_this_computer_for_this_controller_s_calibration(on_wire):
    async def work(wire):
        robot = wire.robot
        row = TableRow(NEAR, tuple(angle + 0.1 for angle in NEAR))
        await robot.push_table(ControllerTable("t" * 64, wire.identity.serial, (row,)))
        other = ControllerTable("u" * 64, "another", (row,))
        with pytest.raises(DeviceRefused, match="is for controller 'another'"):
            await robot.push_table(other)
        await robot.close()
        await wire.second.connect()
        kept = await wire.second.read_table()
        return kept, row, await wire.second.move_to_row(1, 30), wire.second.host_tables.calibration

    kept, row, reached, calibration = on_wire(work)
    assert kept.rows == (row,)
    assert apart(reached, row.compensated) < 0.01
    assert len(calibration) == 64
