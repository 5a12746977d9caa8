"""What the simulated PLC does: the safety chain, the clamp, the watchdog over the computer, its faults."""

from __future__ import annotations

import struct

import pytest

EMERGENCY, GUARD, LOCKED, RESET, CLAMPED, UNCLAMPED, DRIVES = 0, 1, 2, 3, 5, 6, 8


def test_the_safety_chain_is_shown_and_cannot_be_written(bench):
    plc = bench()
    plc.fault("safety.emergency_stop", for_ms=200)
    shown = plc.inputs()
    assert not shown[EMERGENCY]
    assert shown[GUARD]
    assert shown[RESET]
    assert not shown[DRIVES]
    plc.let_pass(0.3)
    shown = plc.inputs()
    assert shown[EMERGENCY]
    assert shown[DRIVES]
    plc.fault("safety.guard_open")
    assert not plc.inputs()[GUARD]


def test_the_guard_is_locked_only_while_it_is_closed(bench):
    plc = bench()
    plc.ask(b"\x05\x00\x00\xff\x00")
    assert plc.inputs()[LOCKED]
    plc.fault("safety.guard_open")
    assert not plc.inputs()[LOCKED]


def test_the_clamp_shows_neither_end_on_its_way(bench):
    plc = bench(clamp_ms=1000)
    assert plc.inputs()[CLAMPED]
    plc.ask(b"\x05\x00\x02\xff\x00")
    shown = plc.inputs()
    assert (shown[CLAMPED], shown[UNCLAMPED]) == (False, False)
    plc.let_pass(1.1)
    shown = plc.inputs()
    assert (shown[CLAMPED], shown[UNCLAMPED]) == (False, True)


def test_a_stuck_clamp_sensor_shows_both_ends(bench):
    plc = bench()
    plc.fault("plc.clamp")
    shown = plc.inputs()
    assert (shown[CLAMPED], shown[UNCLAMPED]) == (True, True)
    assert plc.registers()[10] == 2


def beat(plc, value):
    plc.ask(b"\x06\x00\x00" + struct.pack(">H", value))


def test_without_a_heartbeat_from_the_computer_the_motion_enable_is_dropped_until_it_is_back(bench):
    plc = bench()
    plc.let_pass(3.0)
    assert plc.scene.safety.motion_enabled  # nobody has begun to beat
    for value in (1, 0, 1, 0):
        beat(plc, value)
        plc.let_pass(0.5)
        assert plc.scene.safety.motion_enabled
    plc.let_pass(0.6)
    assert not plc.scene.safety.motion_enabled
    assert not plc.inputs()[DRIVES]
    assert plc.registers()[10] == 1
    assert plc.inputs()[EMERGENCY]  # the chain is no matter of this computer's
    beat(plc, 0)  # the same value: no heartbeat
    assert not plc.scene.safety.motion_enabled
    beat(plc, 1)
    assert plc.inputs()[DRIVES]


@pytest.mark.parametrize(("timeout_ms", "enabled"), [(300, False), (0, True), (5000, True)])
def test_the_watchdogs_time_is_in_its_register(bench, timeout_ms, enabled):
    plc = bench()
    plc.ask(b"\x06\x00\x03" + struct.pack(">H", timeout_ms))
    beat(plc, 1)
    plc.let_pass(0.5)
    assert plc.scene.safety.motion_enabled is enabled
    plc.let_pass(1.0)
    assert plc.scene.safety.motion_enabled is enabled


def test_its_counter_goes_up_ten_times_a_second_and_the_uptime_once(bench):
    plc = bench()
    before = plc.registers()
    plc.let_pass(10.0)
    after = plc.registers()
    assert after[7] - before[7] == pytest.approx(100, abs=2)
    uptimes = [registers[8] << 16 | registers[9] for registers in (before, after)]
    assert uptimes[1] - uptimes[0] == pytest.approx(10, abs=1)


def test_the_word_order_is_that_of_the_address(bench):
    high, low = bench().registers()[8:10]
    swapped = bench("modbus+tcp://p:502?words=low_first").registers()[8:10]
    assert swapped[1] == high
    assert swapped[0] == low


def test_a_stale_plc_answers_with_what_it_knew(bench):
    plc = bench()
    plc.fault("plc.stale", for_ms=1000)
    before = plc.registers()
    plc.fault("safety.emergency_stop")
    plc.let_pass(0.5)
    assert plc.registers() == before
    assert plc.inputs()[EMERGENCY]
    plc.let_pass(1.0)
    assert not plc.inputs()[EMERGENCY]
    assert plc.registers()[7] > before[7]


@pytest.mark.parametrize("sensor", [1, 2, 3, 4, 5, 6])
def test_a_broken_sensor_shows_8000_and_the_others_go_on(bench, sensor):
    plc = bench()
    plc.fault("plc.sensor", sensor=sensor)
    shown = plc.registers()
    assert [i for i, value in enumerate(shown[:6], 1) if value == 0x8000] == [sensor]
    assert shown[10] == 3


def test_a_plc_that_is_gone_hangs_up_and_answers_nobody(bench):
    plc = bench()
    assert len(plc.inputs()) == 14
    plc.fault("plc.gone")
    assert plc.received(plc.client, 1) == b""
    other = plc.call()
    other.sendall(plc.framed(b"\x03\x00\x01\x00\x01"))
    plc.let_pass(5.0)
    other.settimeout(0.1)
    with pytest.raises(TimeoutError):
        other.recv(1)


def test_a_plc_that_was_gone_is_back_at_the_same_port(bench):
    plc = bench()
    begun = plc.kernel.now
    plc.fault("plc.gone", for_ms=2000)
    assert plc.ask(b"\x03\x00\x01\x00\x01", client=plc.call()) == b"\x03\x02\x00\x00"
    assert plc.kernel.now - begun >= 2e9
