"""Searches of the KUKA driver against a hand-written controller that owns the cell's time."""

from __future__ import annotations

import asyncio
import itertools
import math
import threading

import pytest

from cellctl.devices import DeviceFault, DeviceLost, LimitExceeded, SearchEnd
from drivers.kuka_rsi.cyclic.shared_block import Slot

TWO_DEG = (0.0, -88.0, 90.0, 0.0, 45.0, 0.0)


def steps_of(controller):
    """Set-point steps per cycle, Euclidean, deg."""
    sent = [answer.correction for answer in controller.answers]
    return [math.dist(a, b) for a, b in itertools.pairwise(sent)]


def event_in_cycle(controller, number):
    """An event that is set in this cycle of the controller's next RSI session."""
    reached, loop = asyncio.Event(), asyncio.get_running_loop()
    controller.on_cycle = lambda cycle: loop.call_soon_threadsafe(reached.set) if cycle == number else None
    return reached


def test_a_search_without_contact_ends_at_the_line_s_end_with_the_robot_held_there(controller, connected, run):
    async def search():
        async with connected() as robot:
            return await robot.search(TWO_DEG, 1.0), await robot.joints()

    result, joints = run(search())
    assert result.end is SearchEnd.TRAVEL
    assert result.resting == pytest.approx(TWO_DEG, abs=0.002)
    assert joints == pytest.approx(TWO_DEG, abs=0.002)
    assert (result.late, result.lost, result.skipped) == (0, 0, 0)
    assert not controller.in_rsi
    assert controller.commands.count("HALT") == 0


def test_corrections_are_absolute_start_at_zero_and_move_every_axis_in_proportion(controller, connected, run, home):
    end = tuple(a + b for a, b in zip(home, (1.0, -0.5, 0.25, 0, 0, 2.0), strict=True))

    async def search():
        async with connected() as robot:
            await robot.search(end, 2.0)

    run(search())
    assert controller.answers[0].correction == (0,) * 6
    for answer in controller.answers:
        a1 = answer.correction[0]
        assert answer.correction == pytest.approx((a1, -a1 / 2, a1 / 4, 0, 0, 2 * a1), abs=2e-6)
    assert controller.answers[-1].correction == (1.0, -0.5, 0.25, 0, 0, 2.0)


def test_every_reply_echoes_its_telegram_s_count_and_keeps_the_configuration_s_order(controller, connected, run):
    async def search():
        async with connected() as robot:
            await robot.search(TWO_DEG, 2.0)

    run(search())
    counts = [int(answer.ipoc) for answer in controller.answers]
    assert counts == list(range(counts[0], counts[0] + 4 * len(counts), 4))
    first = controller.answers[0]
    assert first.raw == (
        b'<Sen Type="CELLCTL"><AK A1="0.000000" A2="0.000000" A3="0.000000" A4="0.000000" A5="0.000000" A6="0.000000"/>'
        b"<Stop>0</Stop><IPOC>123460</IPOC></Sen>"
    )


def test_set_points_keep_speed_acceleration_and_jerk_limits_up_to_the_end(controller, connected, run):
    limits = {"speed_deg_s": 1.5, "acceleration_deg_s2": 15, "jerk_deg_s3": 300}

    async def search():
        async with connected(limits) as robot:
            await robot.search(TWO_DEG, 1.5)

    run(search())
    path = [answer.correction[1] for answer in controller.answers]
    rounding = 1e-6
    for order, bound in ((1, 1.5), (2, 15), (3, 300)):
        path = [b - a for a, b in itertools.pairwise(path)]
        assert max(map(abs, path)) <= bound * 0.004**order + 2**order * rounding
        if order == 1:
            assert max(path) == pytest.approx(1.5 * 0.004, rel=1e-3)


def test_the_set_point_stands_in_the_second_telegram_after_contact(controller, connected, run):
    async def search():
        async with connected() as robot:
            controller.on_cycle = lambda cycle: robot.stop_now() if cycle == 100 else None
            return await robot.search(TWO_DEG, 2.0)

    result = run(search())
    steps = steps_of(controller)
    full = 2.0 * 0.004
    assert steps[98] == pytest.approx(full, abs=1e-5)
    assert steps[99] == pytest.approx(full / 2, abs=1e-5)
    assert max(steps[100:]) == 0
    assert result.end is SearchEnd.STOPPED
    assert result.stop_cycles == 2


def test_after_contact_the_robot_stands_still_before_rsi_is_left(controller, connected, run):
    controller.follow = 0.05

    async def search():
        async with connected() as robot:
            controller.on_cycle = lambda cycle: robot.stop_now() if cycle == 150 else None
            return await robot.search(TWO_DEG, 2.0)

    result = run(search())
    last_ten = result.joints[-10:]
    assert max(row[1] for row in last_ten) - min(row[1] for row in last_ten) <= 0.001
    assert result.resting[1] - (-90) == pytest.approx(controller.answers[-1].correction[1], abs=0.02)
    assert [answer.stop for answer in controller.answers].index(True) == len(controller.answers) - 1


def test_a_stop_before_the_first_telegram_moves_nothing(controller, connected, run):
    async def search():
        async with connected() as robot:
            controller.on_cycle = lambda cycle: robot.stop_now() if cycle == 0 else None
            return await robot.search(TWO_DEG, 2.0)

    result = run(search())
    assert result.end is SearchEnd.STOPPED
    assert {answer.correction for answer in controller.answers} == {(0,) * 6}
    assert result.stop_cycles == 1


def test_a_stop_said_before_a_search_stops_every_search_until_it_is_cleared(controller, connected, run):
    async def search():
        async with connected() as robot:
            robot.stop_now()
            stopped = [await robot.search(TWO_DEG, 2.0), await robot.search(TWO_DEG, 2.0)]
            before = {answer.correction for answer in controller.answers}
            robot.clear_stop()
            return stopped, before, await robot.search(TWO_DEG, 2.0)

    stopped, before, free = run(search())
    assert [result.end for result in stopped] == [SearchEnd.STOPPED, SearchEnd.STOPPED]
    assert before == {(0,) * 6}
    assert free.end is SearchEnd.TRAVEL


def test_a_stop_that_falls_between_two_searches_is_not_lost(controller, connected, run):
    """A probe armed after the first search may say its edge before the second one has begun."""

    async def search():
        async with connected() as robot:
            await robot.search(TWO_DEG, 2.0)
            robot.clear_stop()
            moved = len(controller.answers)
            threading.Thread(target=robot.stop_now).start()
            while not robot._lines.process.block.words[Slot.STOP]:
                await asyncio.sleep(0)
            return await robot.search((0.0, -90.0, 90.0, 0.0, 45.0, 0.0), 2.0), moved

    result, moved = run(search())
    assert result.end is SearchEnd.STOPPED
    assert {answer.correction for answer in controller.answers[moved:]} == {(0,) * 6}
    assert result.resting == pytest.approx(TWO_DEG, abs=0.002)


def test_holding_the_idle_robot_does_not_stop_the_next_search_once_cleared(controller, connected, run):
    async def search():
        async with connected() as robot:
            await robot.stop()
            robot.clear_stop()
            return await robot.search(TWO_DEG, 2.0)

    assert run(search()).end is SearchEnd.TRAVEL


def test_samples_carry_the_cell_s_time_of_each_cycle(controller, connected, run):
    async def search():
        async with connected() as robot:
            return await robot.search(TWO_DEG, 2.0)

    result = run(search())
    assert len(result.times_ns) == len(controller.answers)
    assert {b - a for a, b in itertools.pairwise(result.times_ns)} == {4_000_000}
    assert result.ipoc == tuple(int(answer.ipoc) for answer in controller.answers)
    halfway = (result.times_ns[100] + result.times_ns[101]) // 2
    assert result.joints[100][1] < result.joints_at(halfway)[1] < result.joints[101][1]


@pytest.mark.parametrize(
    ("end", "speed", "limit"),
    [
        ((0.0, -84.9, 90.0, 0.0, 45.0, 0.0), 1.0, "correction_deg"),
        ((4.0, -86.0, 90.0, 0.0, 45.0, 0.0), 1.0, "travel_deg"),
        (TWO_DEG, 2.1, "speed_deg_s"),
        (TWO_DEG, 0.0, "speed"),
        (TWO_DEG, float("nan"), "speed"),
        ((0.0, float("nan"), 90.0, 0.0, 45.0, 0.0), 1.0, "joint readings"),
        ((0.0, -88.0), 1.0, "joint readings"),
    ],
)
def test_a_search_beyond_a_limit_is_refused_before_rsi_is_switched_on(controller, connected, run, end, speed, limit):
    async def search():
        async with connected() as robot:
            with pytest.raises(LimitExceeded, match=limit):
                await robot.search(end, speed)

    run(search())
    assert "RSI" not in controller.commands


def test_two_searches_in_a_row_each_start_from_zero(controller, connected, run, home):
    async def search():
        async with connected() as robot:
            first = await robot.search(TWO_DEG, 2.0)
            before = len(controller.answers)
            second = await robot.search(home, 2.0)
            return first, second, before

    first, second, before = run(search())
    assert first.end is second.end is SearchEnd.TRAVEL
    assert controller.answers[before].correction == (0,) * 6
    assert second.resting[1] == pytest.approx(-90, abs=0.002)
    assert len(second.ipoc) == len(controller.answers) - before
    assert second.lost == 0


@pytest.mark.parametrize(("first", "step"), [(0, 1), (7, 12), (2_147_483_640, 4)])
def test_counts_that_start_anywhere_and_step_as_they_like_are_understood(controller, connected, run, first, step):
    controller.ipoc, controller.ipoc_step = first, step
    controller.cycle_ns = 12_000_000 if step == 12 else 4_000_000

    async def search():
        async with connected(more="&cycle=ipo" if step == 12 else "") as robot:
            return await robot.search(TWO_DEG, 2.0)

    result = run(search())
    assert result.end is SearchEnd.TRAVEL
    assert result.lost == 0
    assert result.ipoc[1] - result.ipoc[0] == step
    assert result.times_ns[1] - result.times_ns[0] == controller.cycle_ns


def test_the_root_s_attribute_does_not_matter(controller, connected, run):
    controller.root = '<Rob TYPE="KUKA" Other="1">'

    async def search():
        async with connected() as robot:
            return await robot.search(TWO_DEG, 2.0)

    assert run(search()).end is SearchEnd.TRAVEL


def test_after_a_stall_only_the_newest_telegram_is_answered_and_the_rest_are_counted(controller, connected, run):
    controller.burst_at = 60

    async def search():
        async with connected() as robot:
            return await robot.search(TWO_DEG, 2.0)

    result = run(search())
    answered = {int(answer.ipoc) for answer in controller.answers}
    unanswered = [ipoc for ipoc in result.ipoc if ipoc not in answered]
    assert result.end is SearchEnd.TRAVEL
    assert len(unanswered) == result.skipped <= 3
    assert len(result.ipoc) == len(answered) + result.skipped
    assert result.lost == 0


def test_lost_telegrams_are_counted_and_the_path_goes_on_from_standstill(controller, connected, run):
    controller.unsent = range(100, 105)

    async def search():
        async with connected() as robot:
            return await robot.search(TWO_DEG, 2.0)

    result = run(search())
    steps = steps_of(controller)
    assert (result.lost, result.skipped) == (5, 0)
    assert steps[98] == pytest.approx(0.008, abs=1e-5)
    assert steps[99] < 0.001
    assert result.end is SearchEnd.TRAVEL


def test_the_controller_s_own_late_count_is_reported(controller, connected, run):
    controller.delay_counts = True

    async def search():
        async with connected() as robot:
            result = await robot.search(TWO_DEG, 2.0)
            return result, await robot.health()

    result, health = run(search())
    assert result.late == (len(controller.answers) - 1) // 100 > 0
    assert health.figures["late_reported"] == result.late
    assert health.figures["unreadable"] == 0


def test_malformed_telegrams_are_counted_and_not_answered(controller, connected, run):
    controller.garbage = b"<Rob><AIPos A1='1'/></Rob>"

    async def search():
        async with connected() as robot:
            return await robot.search(TWO_DEG, 2.0), await robot.health()

    result, health = run(search())
    assert result.end is SearchEnd.TRAVEL
    assert health.figures["malformed"] == len(controller.answers) == len(result.ipoc)


def test_no_telegram_ends_the_search_with_the_cure_and_rsi_off(controller, connected, run):
    controller.silent = True

    async def search():
        async with connected() as robot:
            with pytest.raises(DeviceLost, match="no telegram") as lost:
                await robot.search(TWO_DEG, 2.0)
            return lost.value, robot.listening()[1]

    lost, port = run(search())
    assert str(port) in lost.cure
    assert "firewall" in lost.cure
    assert controller.commands[-1] == "HALT"
    assert not controller.in_rsi


def test_telegrams_that_cease_for_good_end_the_search(controller, connected, run):
    controller.unsent = range(50, 10_000_000)

    async def search():
        async with connected() as robot:
            with pytest.raises(DeviceLost, match="no telegram for"):
                await robot.search(TWO_DEG, 2.0)

    run(search())
    assert not controller.in_rsi


def test_a_controller_message_is_a_fault_with_its_text_and_names_sentype(controller, connected, run):
    controller.message_at = 100

    async def search():
        async with connected() as robot:
            with pytest.raises(DeviceFault, match="KSS29002") as fault:
                await robot.search(TWO_DEG, 2.0)
            health = await robot.health()
            await robot.reset()
            return fault.value, health, await robot.move(TWO_DEG, 10)

    fault, health, joints = run(search())
    assert "SENTYPE" in fault.cure
    assert not health.ok
    assert joints == pytest.approx(TWO_DEG)


def test_corrections_without_effect_are_named_with_sentype(controller, connected, run):
    controller.follow = 0.0

    async def search():
        async with connected() as robot:
            with pytest.raises(DeviceFault, match=r"did not follow.*A2 -0\.11 deg off") as fault:
                await robot.search((0.0, -89.89, 90.0, 0.0, 45.0, 0.0), 2.0)
            return fault.value

    assert "SENTYPE" in run(search()).cure


@pytest.mark.parametrize(("speed", "cycle_ms"), [(0.5, 4), (2.0, 4), (2.0, 12)])
def test_corrections_do_not_pile_up_where_the_robot_does_not_follow(controller, connected, run, speed, cycle_ms):
    """Without Delay only the reported joints tell; what may pile up is what a lag of 0.15 s may hide."""
    controller.follow = 0.0
    controller.cycle_ns, controller.ipoc_step = cycle_ms * 1_000_000, cycle_ms

    async def search():
        async with connected(more="&cycle=ipo" if cycle_ms == 12 else "") as robot:
            with pytest.raises(DeviceFault, match="behind the set-point"):
                await robot.search(TWO_DEG, speed)

    run(search())
    piled_up = max(answer.correction[1] for answer in controller.answers)
    assert piled_up <= speed * (0.15 + 4 * cycle_ms / 1000) + 0.02 + 1e-4


def test_a_guard_that_grows_old_holds_the_robot_and_is_named(controller, connected, run):
    async def search():
        async with connected() as robot:
            guard = robot.guard("probe")
            controller.on_cycle = lambda cycle: guard.beat(controller.now_ns) if cycle <= 60 else None
            with pytest.raises(DeviceLost, match=r"probe: no sign of life for 0\.10"):
                await robot.search(TWO_DEG, 2.0, {"probe": 0.1})

    run(search())
    moving = [i for i, step in enumerate(steps_of(controller)) if step]
    assert moving[-1] - 60 == pytest.approx(26, abs=2)
    assert controller.answers[-1].stop


def test_a_guard_that_never_beat_counts_from_the_search_s_start(controller, connected, run):
    async def search():
        async with connected() as robot:
            with pytest.raises(DeviceLost, match="probe"):
                await robot.search(TWO_DEG, 2.0, {"probe": 0.2})

    run(search())
    moving = [i for i, step in enumerate(steps_of(controller)) if step]
    assert moving[-1] == pytest.approx(50, abs=2)


def test_a_guard_that_keeps_beating_lets_the_search_end(controller, connected, run):
    async def search():
        async with connected() as robot:
            guard = robot.guard("probe")
            controller.on_cycle = lambda cycle: guard.beat(controller.now_ns)
            return await robot.search(TWO_DEG, 2.0, {"probe": 0.01})

    assert run(search()).end is SearchEnd.TRAVEL


def test_the_robot_holds_when_the_engine_s_heartbeat_stops(controller, connected, run):
    async def search():
        async with connected() as robot:

            def kill_heartbeat(cycle):
                if cycle == 60:
                    loop.call_soon_threadsafe(robot._lines._beating.cancel)

            loop = asyncio.get_running_loop()
            controller.on_cycle = kill_heartbeat
            with pytest.raises(DeviceLost, match="engine: no sign of life"):
                await robot.search(TWO_DEG, 2.0)

    run(search())
    moving = [i for i, step in enumerate(steps_of(controller)) if step]
    assert 100 <= moving[-1] <= 60 + 65 + 10


def test_cancelling_a_search_stops_the_set_point_and_halts(controller, connected, run):
    async def search():
        async with connected() as robot:
            reached = event_in_cycle(controller, 80)
            task = asyncio.create_task(robot.search(TWO_DEG, 2.0))
            await reached.wait()
            task.cancel()
            with pytest.raises(asyncio.CancelledError):
                await task
            assert not controller.in_rsi
            robot.clear_stop()
            result = await robot.search(tuple(controller.joints), 1.0)
            return result, controller.commands.count("HALT")  # before closing, which may halt once more, to be sure

    result, halts = run(search())
    assert halts == 1
    assert result.end is SearchEnd.TRAVEL


def test_stop_ends_a_search_as_a_fault_not_as_contact(controller, connected, run):
    async def search():
        async with connected() as robot:
            reached = event_in_cycle(controller, 80)
            task = asyncio.create_task(robot.search(TWO_DEG, 2.0))
            await reached.wait()
            await robot.stop()
            with pytest.raises(DeviceFault, match="HALT"):
                await task

    run(search())
    assert not controller.in_rsi


def test_a_lost_connection_in_a_search_is_reported(controller, connected, run):
    async def search():
        async with connected() as robot:
            controller.on_cycle = lambda cycle: controller.hang_up() if cycle == 80 else None
            with pytest.raises(DeviceLost, match="closed"):
                await robot.search(TWO_DEG, 2.0)

    run(search())


def test_a_robot_that_was_moved_since_is_not_searched_with(controller, connected, run):
    async def search():
        async with connected() as robot:
            await robot.joints()

            def nudge(cycle):
                if cycle == 0:
                    controller.joints[0] += 1.0

            controller.on_cycle = nudge
            with pytest.raises(DeviceFault, match="RSI_ON"):
                await robot.search(TWO_DEG, 2.0)

    run(search())
    assert {answer.correction for answer in controller.answers} == {(0,) * 6}


@pytest.mark.parametrize("cancelled", [False, True])
def test_rsi_switched_on_by_hand_after_a_search_is_not_answered(controller, connected, run, cancelled):
    async def search():
        async with connected() as robot:
            reached = event_in_cycle(controller, 150)
            task = asyncio.create_task(robot.search(TWO_DEG, 2.0))
            await reached.wait()
            if cancelled:
                task.cancel()
            await asyncio.gather(task, return_exceptions=True)
            ignored = event_in_cycle(controller, 20)
            controller.waits_s = 0.005
            before = len(controller.answers)
            controller.switch_rsi_on_by_hand()
            await ignored.wait()
            return before, (await robot.health()).figures["telegrams"]

    before, telegrams = run(search())
    assert len(controller.answers) == before
    assert telegrams > before


@pytest.mark.parametrize("jump", [100_000, 404, 1])
def test_a_count_that_leaps_ends_the_search_with_the_robot_held_and_halted(controller, connected, run, jump):
    def leap(cycle):
        if cycle == 150:
            controller.ipoc += jump - controller.ipoc_step
            controller._line.settimeout(0.2)

    controller.on_cycle = leap

    async def search():
        async with connected() as robot:
            with pytest.raises(DeviceLost, match=f"count has risen by {jump} since the last answer") as lost:
                await robot.search(TWO_DEG, 2.0)
            return lost.value, await robot.health()

    lost, health = run(search())
    assert "tolerance=" in lost.cure
    assert controller.commands[-1] == "HALT"
    assert not controller.in_rsi
    assert len(controller.answers) == 150
    assert health.figures["beyond"] > 0


def test_a_gap_within_the_tolerance_that_the_address_states_is_bridged(controller, connected, run):
    controller.unsent = range(100, 220)

    async def search():
        async with connected(more="&tolerance=125") as robot:
            return await robot.search(TWO_DEG, 2.0)

    result = run(search())
    assert (result.end, result.lost) == (SearchEnd.TRAVEL, 120)
    assert max(steps_of(controller)) <= 0.008 + 2e-6


def test_telegrams_from_another_address_are_not_answered_and_the_error_names_it(controller, connected, run):
    controller.waits_s = 0.001

    async def search():
        async with connected(more="&controller=127.0.0.9") as robot:
            with pytest.raises(DeviceLost, match=r"no telegram came.*[1-9]\d* datagrams came from other hosts") as lost:
                await robot.search(TWO_DEG, 2.0)
            return lost.value, await robot.health()

    lost, health = run(search())
    assert "than 127.0.0.9 (the last one seen from 127.0.0.1:" in str(lost)
    assert "controller=IP" in lost.cure
    assert controller.answers == []
    assert health.figures["foreign"] > 16
    assert "came from other hosts" in health.text
