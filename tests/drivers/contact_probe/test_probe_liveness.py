"""What is taken for a live probe, and what only looks like one: repeated lines, old lines, a clock that is wrong."""

from __future__ import annotations

import asyncio
from functools import partial

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cellctl.devices import DeviceLost, DeviceUnreachable
from drivers.contact_probe.lines import Boot, Heartbeat, Introduction, Line, Opened
from drivers.contact_probe.ticks import Liveness
from drivers.serial_port import SerialPort

MS = 1_000_000
TICK_HZ = 2_000_000
BEAT = Heartbeat("ARMED", 1650, 1)


async def lost(b, words: str, *, within_ms: float = 250) -> None:
    """The search ends by the probe's loss, the robot halted, with no proof of life in the last 170 ms."""
    begun = b.clock.time_ns
    async with b.clock.timeout(5.0):
        with pytest.raises(DeviceLost, match=words) as caught:
            await b.probe.contact()
    assert b.clock.time_ns - begun < within_ms * MS
    assert b.stop.times == 1
    assert b.clock.time_ns - b.stop.beats[-1] >= 170 * MS
    assert caught.value.cure


def repeat(b, lines: list[bytes]) -> None:
    """The probe sends nothing of its own any more; `lines` come in, one every 50 ms, again and again for 4 s."""
    b.fake.beating = False
    for k in range(80):
        b.fake.after(50 * (k + 1), partial(b.fake.again, lines[k % len(lines)]))


@pytest.mark.parametrize(("count", "words"), [(1, "stands still"), (20, "old line")])
def test_old_heartbeats_again_and_again_are_no_proof_of_life(bench, count, words):
    """The last one, and the traffic of the last second."""

    async def script(b):
        await b.arm()
        await b.clock.sleep(1.2)
        repeat(b, b.fake.lines[-count:])
        await lost(b, f"nothing new for .*{words}")

    bench.run(script)


def test_a_heartbeat_that_keeps_its_number_is_no_proof_of_life(bench):
    async def script(b):
        await b.arm()
        await b.clock.sleep(0.3)
        b.fake.beating = False
        seq = b.fake._seq
        for k in range(80):
            b.fake.after(50 * (k + 1), lambda: b.fake.again(f"HB,{seq},{b.fake.tick()},ARMED,1650,1"))
        await lost(b, f"heartbeat {seq} after heartbeat {seq}", within_ms=300)

    bench.run(script)


def test_a_line_that_is_only_sent_again_is_no_proof_of_life(bench):
    """A program that hangs, but for the part of it that repeats what nobody has acknowledged."""
    bench.fake.forget_ack["OPEN"] = 999

    async def script(b):
        await b.arm()
        await b.clock.sleep(0.3)
        b.fake.beating = False
        b.fake.say("OPEN", 1)
        await lost(b, "line .* again")

    bench.run(script)


def test_a_probe_whose_timer_hangs_is_lost_while_its_heartbeats_go_on(bench):
    async def script(b):
        await b.arm()
        await b.clock.sleep(0.3)
        b.fake.stands_at = b.fake.tick()
        await lost(b, "stands still")

    bench.run(script)


@pytest.mark.parametrize(("rate", "words"), [(0.5, "late"), (0.0625, "late"), (3.0, "ahead")])
def test_a_probe_whose_clock_runs_at_the_wrong_rate_is_lost(bench, rate, words):
    async def script(b):
        await b.arm()
        await b.clock.sleep(0.3)
        b.fake.run_at(rate)
        await lost(b, words, within_ms=600)

    bench.run(script)


def test_lines_that_something_holds_back_ever_longer_do_not_keep_a_search_alive(bench):
    """Each heartbeat comes, one after the other, but later and later: a bridge whose buffer fills."""

    async def script(b):
        await b.arm()
        await b.clock.sleep(0.3)
        begun = b.clock.time_ns
        b.fake.delay_ns = lambda: b.clock.time_ns - begun
        await lost(b, "silent|late", within_ms=600)

    bench.run(script)


def test_a_line_full_of_noise_does_not_hide_that_the_probe_is_silent(bench, monkeypatch):
    monkeypatch.setattr(SerialPort, "waiting", lambda _: True)  # as on a line that is never quiet

    async def script(b):
        await b.arm()
        await b.clock.sleep(0.3)
        b.fake.beating = False
        counts = b.probe._session.link.counts

        async def noise():
            before = counts.crc_errors
            b.fake.raw(b"\x00\xfe~\n")
            while counts.crc_errors == before:  # time stands still until it has been read
                await asyncio.sleep(0.001)

        for k in range(200):
            b.fake.after(20 * k, noise)
        await lost(b, "silent", within_ms=400)

    bench.run(script)


@pytest.mark.parametrize(("rate", "words"), [(None, "stands still"), (0.0625, "counted less than 1 s")])
def test_a_probe_whose_clock_does_not_run_is_not_waited_for_without_end(bench, rate, words):
    if rate is None:
        bench.fake.stands_at = 1234
    else:
        bench.fake.run_at(rate)

    async def script(b):
        begun = b.clock.time_ns
        with pytest.raises(DeviceUnreachable, match=words) as caught:
            async with b.clock.timeout(60.0):
                await b.probe.connect()
        assert b.fake.command_ns - begun < 6_000 * MS
        assert caught.value.cure

    bench.run(script, connected=False)


def test_a_probe_that_is_reset_again_and_again_is_not_waited_for_without_end(bench):
    async def script(b):
        for k in range(100):
            b.fake.after(300 * k, b.fake.reset)
        await b.clock.sleep(0.1)
        with pytest.raises(DeviceLost, match="resets"):
            async with b.clock.timeout(20.0):
                await b.arm()

    bench.run(script)


def test_an_old_answer_that_bears_the_number_of_the_command_does_not_arm(bench):
    """The numbers of commands begin at 0 with each connection, so answers to an earlier one have the same."""
    bench.fake.deaf_to["ARM"] = 99

    async def script(b):
        old = b.fake.tick()
        await b.clock.sleep(0.1)
        b.fake.after(30, lambda: b.fake.again(f"RE,{b.fake._seq - 9},{old},{b.fake.command_seq},OK"))
        with pytest.raises(DeviceLost, match="did not answer ARM"):
            await b.arm()

    bench.run(script)


def test_an_old_heartbeat_is_neither_the_state_nor_the_time_of_the_probe(bench):
    async def script(b):
        old = b.fake.lines[-1]
        await b.clock.sleep(2.0)
        b.fake.state = "FAULT"
        await b.clock.sleep(0.06)
        b.fake.again(old)
        await b.clock.sleep(0.001)
        health = await b.probe.health()
        assert not health.ok
        assert health.figures["old_lines"] == 1
        assert b.probe._session.ticks.last_tick > b.fake.tick() - 0.2 * TICK_HZ

    bench.run(script)


def test_heartbeats_stay_a_proof_of_life_where_their_numbers_begin_again(bench):
    bench.fake._seq = 65_500

    async def script(b):
        await b.arm()
        await b.clock.sleep(1.0)
        assert b.fake._seq < 100
        assert b.stop.times == 0
        assert 19 <= len(b.stop.beats) <= 22
        assert (await b.probe.health()).figures["old_lines"] == 0

    bench.run(script)


# The rule itself, without a port.


def heard(liveness: Liveness, seq: int, time_ns: int, count_ns: int, message=BEAT, *, double=False) -> int | None:
    tick = count_ns * TICK_HZ // 10**9 % 2**32
    return liveness.lateness_ns(Line(seq % 65536, tick, message), time_ns, double=double)


def introduced(first_ns: int = 0) -> Liveness:
    """Has heard the probe say how fast its clock runs, and 40 heartbeats, 50 ms apart, the last at 2 s."""
    liveness = Liveness()
    heard(liveness, 0, 0, first_ns, Introduction(0, 1, "fw", "probe", "1", TICK_HZ, "POWER"))
    for k in range(1, 41):
        assert heard(liveness, k, 50 * k * MS, first_ns + 50 * k * MS) is not None
    return liveness


@settings(max_examples=30, deadline=None)
@given(
    first_seq=st.integers(0, 65535),
    first_ms=st.integers(0, 2**32 * 1000 // TICK_HZ),
    drift=st.floats(-1e-4, 1e-4),
    delays_ms=st.lists(st.integers(0, 45), min_size=40, max_size=80),
    missing=st.sets(st.integers(0, 79)),
)
def test_every_heartbeat_of_a_live_probe_is_one_and_dated_within_what_delays_it(
    first_seq, first_ms, drift, delays_ms, missing
):
    """Whatever the delays below the heartbeats' period, lost lines, drift, and where number and count begin."""
    liveness = Liveness()
    heard(liveness, first_seq - 1, 0, first_ms * MS, Introduction(0, 1, "fw", "probe", "1", TICK_HZ, "POWER"))
    for k, delay_ms in enumerate(delays_ms, 1):
        if k in missing:
            continue
        late_ns = heard(
            liveness, first_seq + k, (50 * k + delay_ms) * MS, round(first_ms * MS + 50 * k * MS * (1 + drift))
        )
        assert late_ns is not None
        assert 0 <= late_ns <= delay_ms * MS + 2 * MS


@settings(max_examples=30, deadline=None)
@given(since_ms=st.integers(0, 50_000), which=st.integers(0, 40), first_ms=st.integers(0, 2**32 * 1000 // TICK_HZ))
def test_no_line_of_the_past_is_new(since_ms, which, first_ms):
    liveness = introduced(first_ms * MS)
    assert heard(liveness, which, (2000 + since_ms) * MS, (first_ms + 50 * which) * MS) is None
    assert liveness.reason


def test_a_count_that_jumps_ahead_is_refused_and_the_lines_after_it_are_not():
    liveness = introduced()
    assert heard(liveness, 41, 2050 * MS, 9050 * MS) is None
    assert "ms ahead" in liveness.reason
    assert heard(liveness, 42, 2100 * MS, 2100 * MS) == 0


def test_a_reset_begins_number_and_count_anew_and_its_repetition_does_not():
    liveness = introduced()
    assert heard(liveness, 0, 2300 * MS, 1, Boot(1, "WATCHDOG")) is not None
    assert heard(liveness, 1, 2350 * MS, 50 * MS) is not None
    heard(liveness, 0, 2400 * MS, 100 * MS, Boot(1, "WATCHDOG"), double=True)
    assert heard(liveness, 1, 2450 * MS, 50 * MS) is None
    assert heard(liveness, 2, 2450 * MS, 150 * MS) is not None


def test_an_event_that_overtakes_a_heartbeat_does_not_make_it_old():
    """Its number may be higher: only the count says in which order lines were begun."""
    liveness = introduced()
    assert heard(liveness, 42, 2040 * MS, 2040 * MS, Opened(7)) is not None
    assert heard(liveness, 41, 2050 * MS, 2050 * MS) is not None


def test_lines_held_back_while_the_host_stood_still_are_dated_by_when_they_were_begun():
    liveness = introduced()
    late = [heard(liveness, k, 4000 * MS, 50 * k * MS) for k in (41, 60, 79)]
    assert late == [pytest.approx((4000 - 50 * k) * MS, abs=2 * MS) for k in (41, 60, 79)]
