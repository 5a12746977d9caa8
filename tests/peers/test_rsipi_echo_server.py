"""The KUKA driver against RSIPI's EchoServer, a controller side written by others, in wall time."""

from __future__ import annotations

import asyncio
import itertools
import math

import pytest

from cellctl.devices import DeviceFault, DeviceLost, SearchEnd

pytestmark = pytest.mark.realtime

TWO_DEG = (0.0, 2.0, 0.0, 0.0, 0.0, 0.0)
SPEED_DEG_S = 2.0
SLOW_DEG_S = 0.5
"""For what happens in mid-search: slow enough that a busy machine gets there before the end of the line."""
TWO_DECIMALS = 0.005 + 1e-9
MODES = pytest.mark.parametrize("mode", ["absolute", "relative"])
CYCLES = pytest.mark.parametrize("cycle_ms", [4, 12])


def lost_increments_deg(late, mode, cycle_ms):
    """What the axis may lack: in relative mode, an increment in a late answer is not repeated."""
    return late * SPEED_DEG_S * cycle_ms / 1000 if mode == "relative" else 0.0


@MODES
@CYCLES
def test_a_joint_goes_two_degrees_and_is_held_there(foreign, run, mode, cycle_ms):
    async def search():
        async with foreign(mode, cycle_ms) as (robot, controller):
            result = await robot.search(TWO_DEG, SPEED_DEG_S)
            return result, controller, await robot.health(), await robot.joints()

    result, controller, health, joints = run(search())
    lacking = lost_increments_deg(health.figures["late_reported"], mode, cycle_ms)
    assert result.end is SearchEnd.TRAVEL
    assert health.figures["cycle_ms"] == cycle_ms
    assert result.ipoc[1] - result.ipoc[0] == cycle_ms
    assert 2.0 - lacking - TWO_DECIMALS <= result.joints[-1][1] <= 2.0 + TWO_DECIMALS
    assert joints[1] == pytest.approx(result.joints[-1][1], abs=TWO_DECIMALS)
    assert {row[1] for row in result.joints[-5:]} == {result.joints[-1][1]}
    assert {row[:1] + row[2:] for row in result.joints} == {(0.0,) * 5}
    held = TWO_DEG if mode == "absolute" else (0.0,) * 6
    assert {answer.correction for answer in controller.taken()[-5:]} == {held}
    assert controller.commands.count("HALT") == 0


@MODES
@CYCLES
def test_no_step_is_larger_than_the_speed_allows(foreign, run, mode, cycle_ms):
    async def search():
        async with foreign(mode, cycle_ms) as (robot, controller):
            await robot.search((0.0, 0.5, 0.0, -0.5, 0.0, 0.0), SPEED_DEG_S)
            return controller.taken()

    taken = [answer.correction for answer in run(search())]
    moved = max(map(math.hypot, *zip(*taken, strict=True)))
    steps = [math.dist(a, b) for a, b in itertools.pairwise(taken)] if mode == "absolute" else [moved]
    assert max(steps) <= SPEED_DEG_S * cycle_ms / 1000 + 2e-6


@MODES
def test_a_contact_stops_it_at_once_and_the_next_search_goes_on(foreign, run, mode):
    async def search():
        async with foreign(mode, 4) as (robot, controller):
            searching = asyncio.create_task(robot.search(TWO_DEG, SLOW_DEG_S))
            await controller.has_gone(0.3)
            robot.stop_now()
            result = await searching
            robot.clear_stop()
            await robot.move((0.0,) * 6, 10)
            return result, await robot.search((0.0, 0.2, 0.0, 0.0, 0.0, 0.0), SPEED_DEG_S)

    stopped, again = run(search())
    assert stopped.end is SearchEnd.STOPPED
    assert 1 <= stopped.stop_cycles <= 2
    assert 0.3 - TWO_DECIMALS <= stopped.joints[-1][1] < 1.9
    assert again.end is SearchEnd.TRAVEL


def test_a_halt_ends_rsi_in_mid_search(foreign, run):
    async def search():
        async with foreign("absolute", 4) as (robot, controller):
            searching = asyncio.create_task(robot.search(TWO_DEG, SLOW_DEG_S))
            await controller.has_gone(0.2)
            await robot.stop()
            with pytest.raises(DeviceFault, match="HALT"):
                await searching
            return controller

    controller = run(search())
    assert controller.commands[-1] == "HALT"
    assert controller.program == "STOPPED"


@MODES
def test_a_controller_that_falls_silent_in_mid_search_is_lost_and_halted(foreign, run, mode):
    async def search():
        async with foreign(mode, 4) as (robot, controller):
            searching = asyncio.create_task(robot.search(TWO_DEG, SLOW_DEG_S))
            await controller.has_gone(0.2)
            controller.freeze()
            with pytest.raises(DeviceLost, match="no telegram for"):
                await searching
            robot.clear_stop()
            await robot.move((0.0,) * 6, 10)
            return controller, await robot.search((0.0, 0.2, 0.0, 0.0, 0.0, 0.0), SPEED_DEG_S)

    controller, again = run(search())
    assert controller.commands.count("HALT") == 1
    assert again.end is SearchEnd.TRAVEL


def test_answers_that_it_rejects_end_in_its_message_with_sentype_named(foreign, run):
    """It goes silent after more faulty answers than its budget; until then nothing moves."""

    async def search():
        async with foreign("absolute", 4, sentype="ImFree", timeout_packets=100) as (robot, controller):
            with pytest.raises(DeviceFault, match="KSS29002") as fault:
                await robot.search(TWO_DEG, SPEED_DEG_S)
            return fault.value, controller, await robot.health()

    fault, controller, health = run(search())
    assert "SENTYPE" in fault.cure
    assert "SENTYPE mismatch (expected 'ImFree', got 'CELLCTL')" in controller.said
    assert "101 faulty packets exceeded Timeout=100" in controller.said
    assert controller.taken() == []
    assert not health.ok


def test_offsets_that_it_sums_up_are_noticed(foreign, run):
    async def search():
        async with foreign("absolute", 4, mode="relative") as (robot, _):
            with pytest.raises(DeviceFault, match="ran ahead"):
                await robot.search(TWO_DEG, SPEED_DEG_S)

    run(search())
