"""Connecting, looking after and letting go of a probe."""

from __future__ import annotations

import asyncio
import fcntl
import os
import pty
import threading
from pathlib import Path

import pytest

from cellctl.clock import WallClock
from cellctl.devices import Address, ContactProbe, DeviceLost, DeviceUnreachable, Surroundings
from drivers.contact_probe.description import open_probe

MS = 1_000_000


def probe_at(address: str) -> ContactProbe:
    return open_probe("probe", Address.parse(address), Surroundings(WallClock(), Path()))


@pytest.mark.parametrize(
    ("address", "words"),
    [
        ("contact+serial://dev/ttyACM0?baud=250000", "three slashes"),
        ("contact+serial://?baud=250000", "names no serial port"),
        ("contact+serial:///dev/ttyACM0?baud=fast", "baud"),
        ("contact+serial:///dev/ttyACM0?baud=0", "baud"),
        ("contact+serial:///dev/ttyACM0?parity=even", "'parity' is not known"),
    ],
)
def test_an_address_that_cannot_be_meant_is_refused_before_anything_is_opened(address, words):
    with pytest.raises(ValueError, match=words):
        probe_at(address)


def test_making_a_probe_opens_nothing():
    assert isinstance(probe_at("contact+serial:///nowhere/at/all"), ContactProbe)


def test_a_missing_port_is_unreachable_with_its_cure():
    with pytest.raises(DeviceUnreachable, match="ENOENT") as caught:
        asyncio.run(probe_at("contact+serial:///dev/tty-that-is-not-there").connect())
    assert "plugged in" in caught.value.cure


def test_a_port_in_use_is_unreachable_and_says_so():
    master, slave = pty.openpty()
    try:
        fcntl.flock(slave, fcntl.LOCK_EX | fcntl.LOCK_NB)
        with pytest.raises(DeviceUnreachable) as caught:
            asyncio.run(probe_at(f"contact+serial://{os.ttyname(slave)}").connect())
        assert "another program" in caught.value.cure
    finally:
        os.close(master)
        os.close(slave)


def test_connecting_says_who_is_there(bench):
    async def script(b):
        who = await b.probe.connect()
        assert (who.device, who.serial, who.model, who.firmware) == ("probe", "SIM-1", "scripted", "fw 1.2")
        assert who.simulated

    bench.run(script, connected=False)


def test_a_probe_that_does_not_say_so_is_not_taken_for_simulated(bench):
    bench.fake.serial = "A-0042"

    async def script(b):
        assert not (await b.probe.connect()).simulated

    bench.run(script, connected=False)


def test_nothing_is_sent_in_the_first_100_ms(bench):
    async def script(b):
        opened = b.clock.time_ns
        task = asyncio.create_task(b.probe.connect())
        while not b.fake.commands:
            await asyncio.sleep(0)
        assert b.clock.time_ns - opened >= 100 * MS
        await task

    bench.run(script, connected=False)


def test_a_board_that_opening_reset_is_waited_for(bench):
    """Silent for 2.5 s, then BOOT: as an Arduino with its boot loader."""
    bench.fake.answering = bench.fake.beating = False

    async def script(b):
        def start():
            b.fake.answering = b.fake.beating = True
            b.fake.say("BOOT", 1, "EXTERNAL")

        b.fake.after(2500, start)
        assert (await b.probe.connect()).serial == "SIM-1"

    bench.run(script, connected=False)


@pytest.mark.parametrize(("beating", "words"), [(False, "does not answer"), (True, "is heard but does not answer")])
def test_a_probe_that_never_answers_is_unreachable_after_5_s(bench, beating, words):
    bench.fake.answering, bench.fake.beating = False, beating

    async def script(b):
        begun = b.clock.time_ns
        with pytest.raises(DeviceUnreachable, match=words) as caught:
            await b.probe.connect()
        assert caught.value.cure
        assert b.fake.command_ns - begun == pytest.approx(5000 * MS, abs=150 * MS)

    bench.run(script, connected=False)


def test_a_wrong_baud_rate_is_distinguished_from_silence(bench):
    bench.fake.answering = bench.fake.beating = False

    async def script(b):
        for ms in range(200, 3000, 200):
            b.fake.after(ms, lambda: b.fake.raw(b"\x8f\xf0\x00\n\xfe"))
        with pytest.raises(DeviceUnreachable, match="nothing that can be read"):
            await b.probe.connect()

    bench.run(script, connected=False)


def test_another_protocol_version_is_refused(bench):
    bench.fake.proto = 2

    async def script(b):
        with pytest.raises(DeviceUnreachable, match="version 2") as caught:
            await b.probe.connect()
        assert "version 1" in caught.value.cure

    bench.run(script, connected=False)


def test_a_port_that_vanishes_while_connecting_is_unreachable(bench):
    async def script(b):
        b.fake.after(600, b.fake.hang_up)
        with pytest.raises(DeviceUnreachable, match="port"):
            await b.probe.connect()

    bench.run(script, connected=False)


def test_health_gives_the_figures_worth_showing(bench):
    bench.fake.drift = 50e-6

    async def script(b):
        await b.clock.sleep(3.0)
        health = await b.probe.health()
        assert health.ok
        assert health.figures["loop_mV"] == 1650
        assert health.figures["clock_drift_ppm"] == pytest.approx(-50, abs=2)  # a fast clock
        assert 0 < health.figures["latency_ms"] < 3
        assert health.figures["heartbeat_age_ms"] < 60
        assert health.figures["lines"] > 60
        assert health.figures["hidden_delay_ms"] < 0.1

    bench.run(script)


def test_health_of_a_probe_at_fault_is_not_well(bench):
    async def script(b):
        b.fake.fault("WIRE")
        await b.clock.sleep(0.2)
        health = await b.probe.health()
        assert not health.ok
        assert "FAULT" in health.text

    bench.run(script)


def test_health_of_a_silent_probe_is_a_loss(bench):
    async def script(b):
        b.fake.silent = True
        await b.clock.sleep(0.5)
        with pytest.raises(DeviceLost, match="silent"):
            await b.probe.health()

    bench.run(script)


def test_stopping_disarms_and_stopping_what_is_not_connected_is_nothing(bench):
    async def script(b):
        await b.probe.stop()
        await b.probe.connect()
        await b.arm()
        await b.probe.stop()
        assert b.fake.state == "DISARMED"

    bench.run(script, connected=False)


def test_closing_disarms_ends_the_thread_and_frees_the_port(bench):
    async def script(b):
        await b.arm()
        await b.probe.close()
        assert b.fake.state == "DISARMED"
        assert not [t for t in threading.enumerate() if t.name == "probe port"]
        await b.probe.close()
        await b.probe.connect()  # the same port, exclusively, again

    bench.run(script)


def test_closing_a_vanished_port_raises_nothing(bench):
    async def script(b):
        b.fake.hang_up()
        await b.probe.close()

    bench.run(script)


def test_a_used_device_that_was_never_connected_is_a_loss_not_a_traceback(bench):
    async def script(b):
        with pytest.raises(DeviceLost, match="not connected"):
            await b.arm()

    bench.run(script, connected=False)


def test_the_count_may_wrap_unheard_between_two_searches(bench):
    async def script(b):
        for _ in range(3):
            b.clock.time_ns += 1_800_000 * MS  # half an hour asleep: more than half a turn of the count
            await b.clock.sleep(0.2)
            b.fake.loop_mv = 1650
            await b.arm()
            truth = b.clock.time_ns + 100 * MS
            b.fake.at(truth, b.fake.touch)
            assert abs((await b.probe.contact()).time_ns - truth) < 0.1 * MS
            await b.probe.disarm()

    bench.run(script)
