"""What a search relies on: the stop before the acknowledgement, the contact's time, and a clear end on a bad day."""

from __future__ import annotations

import asyncio
from types import SimpleNamespace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cellctl.devices import DeviceFault, DeviceLost, DeviceRefused, ProbeNotOpen
from drivers.contact_probe.lines import Boot, Confirmation, Edge, Fault, Heartbeat, Line, Opened
from drivers.contact_probe.session import Search
from drivers.contact_probe.ticks import TickClock

MS = 1_000_000


def test_a_contact_is_reported_with_its_tick_and_bounces(bench):
    async def script(b):
        await b.arm()
        edges = []
        b.fake.after(300, lambda: edges.append(b.fake.touch()))
        contact = await b.probe.contact()
        assert (contact.tick, contact.confirmed, contact.bounces) == (edges[0], True, 3)
        assert b.stop.times == 1

    bench.run(script)


def test_the_robot_is_commanded_to_stop_before_the_edge_is_acknowledged(bench):
    bench.stop.linger_s = 0.05
    seen = {}

    async def script(b):
        await b.arm()
        b.fake.on_ack = lambda seq: seen.setdefault(seq, b.stop.left.is_set())
        edge_seq = []
        b.fake.after(100, lambda: edge_seq.append(b.fake.say("EDGE", b.fake.tick())))
        b.fake.after(150, lambda: b.fake.say("CONF", b.fake.tick(), 1, 0))
        await b.probe.contact()
        assert seen[edge_seq[0]] is True
        assert False in seen.values()  # the heartbeats before it were acknowledged before the stop

    bench.run(script)


@pytest.mark.parametrize(("drift", "first_tick"), [(80e-6, 0), (-120e-6, 2**32 - 3_000_000), (40e-6, 2**32 - 100)])
def test_the_contact_time_holds_with_drift_delays_and_a_wrapping_count(bench, drift, first_tick):
    """Every third line or so comes without extra delay; the others up to 8 ms late."""
    bench.fake.drift, bench.fake.first_tick = drift, first_tick - round(bench.clock.time_ns * 2e-3) % 2**32
    bench.fake.delay_ns = lambda: bench.random.choice(
        (0, bench.random.randrange(8 * MS), bench.random.randrange(8 * MS))
    )
    errors, sigmas = [], []

    async def script(b):
        for wait_ms in (400, 2500, 4000):
            b.fake.loop_mv = 1650
            await b.arm()
            truth = []

            def touch(truth=truth):
                truth.append(b.clock.time_ns)
                b.fake.touch()

            b.fake.after(wait_ms, touch)
            contact = await b.probe.contact()
            errors.append(abs(contact.time_ns - truth[0]))
            sigmas.append(contact.sigma_ns)
            await b.probe.disarm()

    bench.run(script)
    assert max(errors) < 0.1 * MS, errors
    assert all(0 < s < 2 * MS for s in sigmas)


def test_a_delay_that_all_lines_share_is_in_the_contacts_sigma(bench):
    bench.fake.delay_ns = lambda: 3 * MS
    found = []

    async def script(b):
        await b.arm()
        truth = b.clock.time_ns + 500 * MS
        b.fake.at(truth, b.fake.touch)
        contact = await b.probe.contact()
        found.append((contact.time_ns - truth, contact.sigma_ns))

    bench.run(script)
    (error, sigma) = found[0]
    assert error == pytest.approx(3 * MS, abs=0.1 * MS)  # not to be seen from one side …
    assert 1.5 * MS < sigma < 4 * MS  # … and owned up to


def test_an_edge_that_does_not_hold_is_unconfirmed(bench):
    async def script(b):
        await b.arm()

        def spark():
            edge = b.fake.tick()
            b.fake.state = "TRIPPED"
            b.fake.say("EDGE", edge)
            b.fake.after(2, lambda: b.fake.say("CONF", edge, 0, 7))

        b.fake.after(100, spark)
        contact = await b.probe.contact()
        assert (contact.confirmed, contact.bounces) == (False, 7)

    bench.run(script)


def test_an_edge_that_is_never_confirmed_is_neither_confirmed_nor_refuted_and_waited_for_only_so_long(bench):
    async def script(b):
        await b.arm()
        begun = b.clock.time_ns
        b.fake.after(100, lambda: b.fake.say("EDGE", b.fake.tick()))
        b.fake.after(100, lambda: setattr(b.fake, "state", "TRIPPED"))
        contact = await b.probe.contact()
        assert contact.confirmed is None
        assert b.clock.time_ns - begun < 700 * MS

    bench.run(script)


def test_a_spoilt_edge_line_still_ends_the_search_with_the_right_time(bench):
    """The confirmation, or a heartbeat that says TRIPPED, stops the robot; the edge's tick comes with either line."""
    bench.fake.spoil["EDGE"] = 2
    bench.fake.spoil["CONF"] = 1

    async def script(b):
        await b.arm()
        truth = b.clock.time_ns + 210 * MS
        b.fake.at(truth, b.fake.touch)
        contact = await b.probe.contact()
        assert abs(contact.time_ns - truth) < 0.1 * MS
        assert b.stop.times == 1

    bench.run(script)


def test_where_edge_and_confirmation_are_lost_the_next_heartbeat_stops_the_robot(bench):
    bench.fake.spoil["EDGE"] = bench.fake.spoil["CONF"] = 4

    async def script(b):
        await b.arm()
        truth = b.clock.time_ns + 210 * MS
        b.fake.at(truth, b.fake.touch)
        assert abs((await b.probe.contact()).time_ns - truth) < 0.1 * MS
        assert b.stop.at_ns - truth < 55 * MS

    bench.run(script)


def test_a_doubled_line_is_acknowledged_again_and_counts_once(bench):
    bench.fake.forget_ack["EDGE"] = 2
    bench.fake.forget_ack["CONF"] = 2

    async def script(b):
        await b.arm()
        b.fake.after(100, b.fake.touch)
        await b.probe.contact()
        await b.probe.disarm()
        await b.clock.sleep(0.3)
        health = await b.probe.health()
        assert health.figures["doubles"] == 4
        assert b.stop.times == 1

    bench.run(script)


def test_the_edge_of_an_earlier_search_sent_again_does_not_stop_the_next(bench):
    async def script(b):
        await b.arm()
        b.fake.after(100, b.fake.touch)
        first = await b.probe.contact()
        await b.probe.disarm()
        b.fake.loop_mv = 1650
        await b.arm()
        b.fake.say("EDGE", first.tick)  # under a number that the host has not seen
        b.fake.say("CONF", first.tick, 1, 0)
        await b.clock.sleep(0.2)
        assert b.stop.times == 1
        truth = b.clock.time_ns + 50 * MS
        b.fake.at(truth, b.fake.touch)
        assert (await b.probe.contact()).time_ns == pytest.approx(truth, abs=0.1 * MS)
        assert b.stop.times == 2

    bench.run(script)


def test_an_edge_older_than_the_arming_that_was_never_received_stops_the_robot_and_is_a_fault(bench):
    async def script(b):
        await b.arm()
        await b.probe.disarm()
        unheard = b.fake.tick()
        await b.clock.sleep(0.2)
        await b.arm()
        b.fake.say("EDGE", unheard)
        with pytest.raises(DeviceFault, match="from before it was armed"):
            async with b.clock.timeout(2.0):
                await b.probe.contact()
        assert b.stop.times == 1
        assert (await b.probe.health()).figures["refused_edges"] == 1

    bench.run(script)


def test_the_guard_hears_of_every_valid_line_while_armed_and_of_none_after(bench):
    async def script(b):
        await b.arm()
        begun = len(b.stop.beats)
        await b.clock.sleep(1.0)
        assert 19 <= len(b.stop.beats) - begun <= 21
        assert b.stop.beats == sorted(b.stop.beats)
        await b.probe.disarm()
        count = len(b.stop.beats)
        await b.clock.sleep(0.5)
        assert len(b.stop.beats) == count

    bench.run(script)


@pytest.mark.parametrize(
    ("code", "words"), [("WIRE", "broken"), ("STUCK", "closed"), ("RANGE", "voltage"), ("HOST", "host"), ("ODD", "ODD")]
)
def test_a_fault_while_armed_stops_the_robot_and_says_what_it_is(bench, code, words):
    async def script(b):
        await b.arm()
        b.fake.after(120, lambda: b.fake.fault(code))
        with pytest.raises(DeviceFault, match=words) as caught:
            await b.probe.contact()
        assert caught.value.cure
        assert b.stop.times == 1

    bench.run(script)


def test_a_reset_while_armed_voids_the_search(bench):
    async def script(b):
        await b.arm()
        b.fake.after(120, b.fake.reset)
        with pytest.raises(DeviceFault, match=r"reset.*WATCHDOG"):
            await b.probe.contact()
        assert b.stop.times == 1

    bench.run(script)


def test_a_reset_whose_boot_lines_are_lost_is_seen_from_the_heartbeats(bench):
    bench.fake.spoil["BOOT"] = 10

    async def script(b):
        await b.arm()
        b.fake.after(120, b.fake.reset)
        with pytest.raises(DeviceFault, match="DISARMED while armed"):
            await b.probe.contact()
        assert b.stop.times == 1

    bench.run(script)


def test_after_a_reset_the_count_is_fitted_anew_before_the_next_search(bench):
    async def script(b):
        b.fake.reset()
        await b.clock.sleep(0.2)
        await b.arm()
        truth = b.clock.time_ns + 300 * MS
        b.fake.at(truth, b.fake.touch)
        contact = await b.probe.contact()
        assert abs(contact.time_ns - truth) < 0.1 * MS
        assert (await b.probe.health()).figures["resets"] == 1

    bench.run(script)


def test_a_second_reset_soon_after_the_first_counts_too(bench):
    """The same BOOT again, number and count and all: only its time tells it from a line sent again."""

    async def script(b):
        b.fake.reset()
        await b.clock.sleep(0.4)
        b.fake.reset()
        await b.clock.sleep(0.2)
        b.fake.forget_ack["BOOT"] = 2
        b.fake.reset()
        await b.clock.sleep(0.3)
        await b.arm()
        assert (await b.probe.health()).figures["resets"] == 3
        truth = b.clock.time_ns + 300 * MS
        b.fake.at(truth, b.fake.touch)
        assert abs((await b.probe.contact()).time_ns - truth) < 0.1 * MS

    bench.run(script)


def test_a_line_of_a_restarted_probe_is_no_double_of_an_earlier_one_with_its_number(bench):
    """Straight after a reset its numbers are those of just before; an edge among them must stop the robot."""

    async def script(b):
        await b.arm()
        for _ in range(3):
            b.fake.say("OPEN", 1)
        await b.clock.sleep(0.02)
        b.fake._seq -= 3
        truth = b.clock.time_ns
        b.fake.touch()
        assert abs((await b.probe.contact()).time_ns - truth) < 0.1 * MS

    bench.run(script)


@pytest.mark.parametrize(("mv", "words"), [(80, "missed the edge"), (4900, "4900 mV"), (700, "700 mV")])
def test_an_armed_probe_whose_loop_is_not_open_stops_the_robot_at_once_and_is_a_fault(bench, mv, words):
    """An edge, a wire break that the probe has missed: its heartbeat says ARMED, and a voltage that denies it."""

    async def script(b):
        await b.arm()
        b.fake.after(100, lambda: setattr(b.fake, "loop_mv", mv))
        closed_ns = b.clock.time_ns + 100 * MS
        with pytest.raises(DeviceFault, match=words) as caught:
            async with b.clock.timeout(2.0):
                await b.probe.contact()
        assert caught.value.cure
        assert b.stop.times == 1
        assert b.stop.at_ns - closed_ns < 55 * MS
        assert b.clock.time_ns - closed_ns < 600 * MS

    bench.run(script)


def test_a_heartbeat_just_before_the_edge_stops_the_robot_and_the_edge_is_the_contact(bench):
    async def script(b):
        await b.arm()
        edges = []
        b.fake.after(120, lambda: b.fake.say("HB", "ARMED", 80, 1))
        b.fake.after(122, lambda: edges.append(b.fake.touch()))
        contact = await b.probe.contact()
        assert (contact.tick, contact.confirmed) == (edges[0], True)
        assert b.stop.times == 1

    bench.run(script)


def test_a_probe_that_tripped_and_never_says_when_is_a_fault_and_waited_for_only_so_long(bench):
    async def script(b):
        await b.arm()
        tripped_ns = b.clock.time_ns + 120 * MS
        b.fake.at(tripped_ns, lambda: setattr(b.fake, "state", "TRIPPED"))
        with pytest.raises(DeviceFault, match="without saying when") as caught:
            async with b.clock.timeout(2.0):
                await b.probe.contact()
        assert caught.value.cure
        assert b.stop.times == 1
        assert b.stop.at_ns - tripped_ns < 55 * MS
        assert b.clock.time_ns - tripped_ns < 600 * MS

    bench.run(script)


def test_a_state_that_does_not_exist_ends_the_search(bench):
    async def script(b):
        await b.arm()
        b.fake.after(120, lambda: setattr(b.fake, "state", "ASLEEP"))
        with pytest.raises(DeviceFault, match="ASLEEP"):
            async with b.clock.timeout(2.0):
                await b.probe.contact()
        assert b.stop.times == 1

    bench.run(script)


@pytest.mark.parametrize("kind", ["EDGE", "CONF"])
def test_an_edge_later_than_its_own_line_stops_the_robot_and_is_no_contact(bench, kind):
    async def script(b):
        await b.arm()
        fields = (1, 0) if kind == "CONF" else ()
        b.fake.after(100, lambda: b.fake.say(kind, b.fake.tick() + 1, *fields))
        with pytest.raises(DeviceFault, match="future") as caught:
            await b.probe.contact()
        assert caught.value.cure
        assert b.stop.times == 1
        assert (await b.probe.health()).figures["refused_edges"] == 1

    bench.run(script)


def test_an_edge_of_a_count_that_has_jumped_ahead_stops_the_robot_and_is_no_contact(bench):
    """Its line is as far ahead as the edge, so that only the lines before it show that the time has not been."""

    async def script(b):
        await b.arm()

        def jump():
            ahead = b.fake.tick() + 3 * 2_000_000
            b.fake.again(f"EDGE,{b.fake._seq},{ahead},{ahead - 100}")

        b.fake.after(100, jump)
        with pytest.raises(DeviceFault, match="future"):
            async with b.clock.timeout(2.0):
                await b.probe.contact()
        assert b.stop.times == 1
        assert (await b.probe.health()).figures["refused_edges"] == 1

    bench.run(script)


def test_an_edge_that_a_heartbeat_overtakes_is_a_contact(bench):
    async def script(b):
        await b.arm()
        await b.clock.sleep(0.1)
        edge, line_tick = b.fake.tick(), b.fake.tick() + 10
        await b.clock.sleep(0.06)
        b.fake.state, b.fake.loop_mv = "TRIPPED", 80
        b.fake.again(f"EDGE,{b.fake._seq + 3},{line_tick},{edge}")
        assert (await b.probe.contact()).tick == edge

    bench.run(script)


def test_three_missed_heartbeats_stop_the_robot_and_mean_loss(bench):
    async def script(b):
        await b.arm()
        silent_from = b.clock.time_ns + 120 * MS
        b.fake.at(silent_from, lambda: setattr(b.fake, "silent", True))
        with pytest.raises(DeviceLost, match="silent"):
            await b.probe.contact()
        assert 100 * MS < b.clock.time_ns - silent_from < 200 * MS
        assert b.stop.times == 1
        with pytest.raises(DeviceLost):
            await b.arm()

    bench.run(script)


def test_two_lost_heartbeats_are_lived_with(bench):
    async def script(b):
        await b.arm()
        b.fake.spoil["HB"] = 2
        await b.clock.sleep(0.5)
        assert b.stop.times == 0
        assert (await b.probe.health()).figures["crc_errors"] == 2

    bench.run(script)


def test_a_closed_loop_cannot_be_armed_and_the_error_says_what_to_do(bench):
    bench.fake.replies["ARM"] = ["CLOSED"]

    async def script(b):
        with pytest.raises(ProbeNotOpen, match="closed") as caught:
            await b.arm()
        assert "tip" in caught.value.cure
        with pytest.raises(DeviceRefused, match="not armed"):
            await b.probe.contact()
        await b.arm()  # freed: goes on as if nothing had been

    bench.run(script)


def test_a_broken_wire_at_arming_is_a_fault(bench):
    bench.fake.replies["ARM"] = ["WIRE"]

    async def script(b):
        with pytest.raises(DeviceFault, match="broken"):
            await b.arm()

    bench.run(script)


def test_a_probe_left_tripped_is_disarmed_and_armed_again(bench):
    bench.fake.state = "TRIPPED"

    async def script(b):
        await b.arm()
        assert b.fake.commands[-3:] == ["ARM", "DISARM", "ARM"]
        assert b.fake.state == "ARMED"

    bench.run(script)


def test_a_fault_that_disarming_does_not_clear_is_reported(bench):
    bench.fake.state = "FAULT"
    bench.fake.replies["DISARM"] = ["STATE"]

    async def script(b):
        with pytest.raises(DeviceFault, match="stays in FAULT"):
            await b.arm()

    bench.run(script)


def test_a_lost_command_is_sent_again_and_done_once(bench):
    bench.fake.deaf_to["ARM"] = 3

    async def script(b):
        await b.arm()
        assert b.fake.commands.count("ARM") == 4
        assert b.fake.state == "ARMED"
        assert (await b.probe.health()).figures["resends"] == 3

    bench.run(script)


def test_a_command_that_is_never_answered_is_sent_five_times_and_means_loss(bench):
    bench.fake.deaf_to["ARM"] = 99

    async def script(b):
        begun = b.clock.time_ns
        with pytest.raises(DeviceLost, match="ARM"):
            await b.arm()
        assert b.fake.commands.count("ARM") == 5
        assert b.clock.time_ns - begun == pytest.approx(500 * MS, abs=1 * MS)

    bench.run(script)


def test_disarming_ends_the_waiting_for_a_contact(bench):
    async def script(b):
        await b.arm()
        b.clock.call_later(0.2, lambda: tasks.append(asyncio.ensure_future(b.probe.disarm())))
        with pytest.raises(DeviceRefused, match="disarmed"):
            await b.probe.contact()
        await tasks[0]
        assert b.stop.times == 0

    tasks: list[asyncio.Future[None]] = []
    bench.run(script)


def test_an_unplugged_cable_while_armed_stops_the_robot_and_is_a_loss_without_a_traceback(bench):
    async def hang_up():
        bench.fake.hang_up()
        await asyncio.to_thread(bench.stop.entered.wait, 60.0)  # time stands still until the port's thread has seen it

    async def script(b):
        await b.arm()
        b.fake.after(100, hang_up)
        with pytest.raises(DeviceLost, match="port"):
            await b.probe.contact()
        assert b.stop.times == 1
        with pytest.raises(DeviceLost):
            await b.probe.health()
        await b.probe.stop()  # clean-up goes on without it
        await b.probe.close()

    bench.run(script)


def test_whether_the_tip_touches_is_reported_by_a_heartbeat_begun_after_the_question(bench):
    async def script(b):
        await b.arm()
        b.fake.after(300, b.fake.touch)
        await b.probe.contact()
        assert await b.probe.touching()
        asked = b.clock.time_ns
        b.fake.loop_mv = 1650
        assert not await b.probe.touching()
        assert b.clock.time_ns - asked < 120 * MS

    bench.run(script)


def test_a_probe_that_knows_why_there_was_no_contact_is_heard_when_it_is_asked_whether_it_touches(bench):
    async def script(b):
        await b.arm()
        b.fake.after(100, lambda: b.fake.fault("WIRE"))
        await b.clock.sleep(0.3)
        with pytest.raises(DeviceFault, match="WIRE"):
            await b.probe.touching()

    bench.run(script)


def test_a_probe_at_fault_is_no_probe_that_touches_nothing(bench):
    async def script(b):
        b.fake.fault("STUCK")
        with pytest.raises(DeviceFault, match="at fault"):
            await b.probe.touching()

    bench.run(script)


@pytest.mark.parametrize(("mv", "closed"), [(499, True), (1400, False), (2500, False)])
def test_the_limits_of_closed_and_open_are_those_of_the_protocol(bench, mv, closed):
    async def script(b):
        b.fake.loop_mv = mv
        assert await b.probe.touching() is closed

    bench.run(script)


@pytest.mark.parametrize("mv", [500, 1399, 2501, 4900])
def test_a_loop_that_is_neither_open_nor_closed_is_no_loop_that_is_open(bench, mv):
    async def script(b):
        b.fake.loop_mv = mv
        with pytest.raises(DeviceFault, match=f"{mv} mV"):
            await b.probe.touching()

    bench.run(script)


def test_a_probe_that_falls_silent_cannot_say_whether_it_touches(bench):
    async def script(b):
        b.fake.silent = True
        with pytest.raises(DeviceLost):
            await b.probe.touching()

    bench.run(script)


class Timers:
    """A clock that stands still; what was to be called later is called when the test says so."""

    def __init__(self) -> None:
        self.callbacks = []

    def call_later(self, _seconds, callback):
        self.callbacks.append(callback)
        return SimpleNamespace(cancel=lambda: self.callbacks.remove(callback))

    def fire(self) -> None:
        for callback in tuple(self.callbacks):
            callback()


TICKS = st.integers(99_000, 101_500)
MESSAGES = st.one_of(
    st.builds(Edge, TICKS),
    st.builds(Confirmation, TICKS, st.integers(0, 1), st.integers(0, 3)),
    st.builds(Opened, TICKS),
    st.builds(
        Heartbeat,
        st.sampled_from(["ARMED", "TRIPPED", "DISARMED", "FAULT"]),
        st.sampled_from([80, 700, 1650, 4900]),
        st.just(1),
    ),
    st.builds(Fault, st.just("WIRE")),
    st.builds(Boot, st.just(1), st.just("POWER")),
)


@settings(max_examples=200, deadline=None)
@given(lines=st.lists(st.tuples(MESSAGES, st.booleans()), max_size=4))
def test_whatever_halts_the_robot_ends_the_search_and_no_contact_is_later_than_its_line(lines):
    """Else `contact` would wait for ever with the robot held."""
    halts, timers, ticks = [], Timers(), TickClock(2_000_000)
    ticks.add_line(100_000, 50 * MS, 0)
    search = Search("probe", timers, ticks, lambda: halts.append(1), lambda _: None, frozenset({100_050}))
    search.armed()
    for k, (message, new) in enumerate(lines, 1):
        line = Line(k, 100_000 + 100 * k, message)
        if new:
            ticks.add_line(line.tick, 50 * MS + k * 50_000, 0)
        search.at_once(line)
        search.pursue(line, new=new)
    assert len(halts) <= 1
    timers.fire()
    assert search.ended == bool(halts)
    if search.ended and search.trouble is None:
        contact = asyncio.run(search.outcome())
        assert 100_000 <= contact.tick <= 100_000 + 100 * len(lines)
        assert contact.time_ns <= 50 * MS + len(lines) * 50_000
