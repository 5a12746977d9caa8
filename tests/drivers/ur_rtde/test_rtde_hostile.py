"""What a controller, or whatever answers in its place, may send: the line takes what can be, and gives up in doubt."""

from __future__ import annotations

import math
import struct
from functools import partial

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cellctl.devices import DeviceLost, DeviceRefused
from drivers.ur_rtde.codec import Kind, packed
from tests.drivers.ur_rtde.conftest import PERIOD_S, sample


async def all_of_it(line, silence_s=0.5):
    """The cycles of all samples, until the line is given up; why; and the line."""
    times = []

    async def take():
        async with line.streaming(1 / PERIOD_S, lambda one: times.append(one.time_s)):
            while True:
                await line.next(silence_s)

    with pytest.raises(DeviceLost) as lost:
        await take()
    return [round((time - 100.0) / PERIOD_S) for time in times], str(lost.value), line


soon = partial(all_of_it, silence_s=0.05)


def cycles(*numbers):
    return b"".join(map(sample, numbers))


def test_repeated_samples_are_dropped_and_counted(against):
    times, why, line = against(cycles(0, 1, 1, 1, 2), all_of_it)
    assert (times, line.stale) == ([0, 1, 2], 2)
    assert "no data came for 0.5 s" in why


def test_left_out_samples_are_counted(against):
    times, _, line = against(cycles(0, 1, 4, 5), all_of_it)
    assert (times, line.skipped) == ([0, 1, 4, 5], 2)


def test_a_sample_that_comes_one_late_is_stale(against):
    times, _, line = against(cycles(0, 2, 1, 3), all_of_it)
    assert (times, line.stale) == ([0, 2, 3], 1)


@pytest.mark.parametrize(("numbers", "says"), [((9, 10, 3), "went back by 0.014 s"), ((0, 1, 9000), "jumped by 17.9")])
def test_a_clock_that_jumps_ends_the_line(against, numbers, says):
    times, why, _ = against(cycles(*numbers), all_of_it)
    assert len(times) == 2
    assert says in why


@pytest.mark.parametrize(
    ("bad", "says"),
    [
        (sample(2, joint=math.nan), "not finite"),
        (sample(2, recipe=2), "of recipe 2"),
        (packed(Kind.DATA, b"\x01\x00"), "of 2 bytes"),
        (b"\x00\x01\x00", "of 1 bytes is announced"),
        (b"\xff\xff\x55", "of 65535 bytes is announced"),
        (packed(Kind.START, b"\x01"), "not asked for"),
        (struct.pack(">HB", 3, 200), "not asked for"),
    ],
)
def test_a_package_that_cannot_be_ends_the_line_and_says_why(against, bad, says):
    times, why, _ = against(cycles(0, 1) + bad + cycles(2, 3), all_of_it)
    assert times == [0, 1]
    assert says in why


@settings(max_examples=20)
@given(st.lists(st.integers(0, 60), max_size=30))
def test_the_samples_that_are_taken_are_in_order_whatever_comes(against, numbers):
    times, _, _ = against(cycles(0, *numbers), soon)
    assert times == sorted(set(times))


@settings(max_examples=20)
@given(st.binary(min_size=1, max_size=200))
def test_any_bytes_end_in_silence_or_in_an_error_that_is_named(against, data):
    _, why, _ = against(cycles(0) + data, soon)
    assert "no data came" in why or "the RTDE connection broke" in why


def refused(against, **settings):
    with pytest.raises(DeviceRefused) as error:
        against(b"", lambda line: line.reserve("beat", ("input_int_register_24",)), **settings)
    return str(error.value)


def test_old_software_is_refused(against):
    assert "its software is 5.3.0; 5.4 is needed" in refused(against, version=(5, 3, 0, 0))


def test_a_controller_that_does_not_speak_the_protocol_is_refused(against):
    answers = {Kind.REQUEST_PROTOCOL: packed(Kind.REQUEST_PROTOCOL, b"\x00")}
    assert "does not speak RTDE 2" in refused(against, answers=answers)


def test_registers_that_another_program_writes_are_refused(against):
    answers = {Kind.INPUTS: packed(Kind.INPUTS, b"\x00IN_USE")}
    assert "another program writes input_int_register_24" in refused(against, answers=answers)
