"""Every listed return code leads to what a caller can do."""

from __future__ import annotations

import pytest

from cellctl.devices import (
    DeviceBusy,
    DeviceError,
    DeviceFault,
    DeviceLost,
    DeviceRefused,
    NotLevelled,
    OutOfRange,
    TargetLost,
)
from drivers.geocom_tracker.codes import CODES, Meaning, code_of, error_of
from tests.helpers.station import FINE, FULL, LOCK_IN, TEMPERATURE, TURN

LISTED = """
0 1 2 3 4 5 6 8 12 13 14 16 18 21 22 23 24 25 26 27
770 775 776 786 818 819 823 829
1283 1284 1285 1288 1289 1290 1291 1292 1293 1294
1792 1793 1799 1804 1805 1806 1807 1808
3077 3078 3081 3085 3093 3094 3100 3101 3102 3108 3109 3110
8704 8705 8706 8707 8708 8709 8710 8711 8712 8713 8714 8716 8720 8723 8725
"""
"""From the protocol's facts; a copy on purpose: the table must not lose one."""


@pytest.mark.parametrize("number", [int(text) for text in LISTED.split()])
def test_every_listed_code_has_a_meaning_and_a_cure(number):
    code = CODES[number]
    assert code.what
    assert code.cure or code.meaning is Meaning.DONE


@pytest.mark.parametrize(
    ("number", "error"),
    [
        (8710, TargetLost),
        (8711, TargetLost),
        (1292, TargetLost),
        (1285, TargetLost),
        (770, TargetLost),
        (818, OutOfRange),
        (829, OutOfRange),
        (13, DeviceBusy),
        (1293, DeviceBusy),
        (22, NotLevelled),
        (2, DeviceRefused),
        (27, DeviceRefused),
        (14, DeviceFault),
        (1804, DeviceFault),
        (12, DeviceLost),
        (3077, DeviceLost),
    ],
)
def test_a_code_is_the_error_that_names_what_to_do(number, error):
    found = error_of("tracker", number, "AUT_FineAdjust")
    assert type(found) is error
    assert found.cure
    assert f"return code {number} of AUT_FineAdjust" in str(found)


def test_a_code_that_is_not_listed_is_a_fault_with_its_name():
    assert code_of(1392).meaning is Meaning.FAULT
    assert "TMC_INC_ERROR" in str(error_of("tracker", 1392))
    assert "unknown" in str(error_of("tracker", 60000))


@pytest.mark.parametrize(
    ("rpc", "code", "error", "words"),
    [
        (TURN, 8707, DeviceFault, "motors"),
        (TURN, 2, DeviceRefused, "parameter"),
        (FINE, 8710, TargetLost, "no reflector"),
        (FINE, 8711, TargetLost, "several reflectors"),
        (LOCK_IN, 8725, TargetLost, "cannot lock"),
    ],
)
def test_aiming_reports_what_the_instrument_answered(station, run, rpc, code, error, words):
    async def work(tracker):
        station.codes[rpc] = [code]
        with pytest.raises(error, match=words):
            await tracker.aim((1000.0, 2000.0, 300.0), 40.0)

    run(work)


@pytest.mark.parametrize(
    ("code", "error"),
    [(818, OutOfRange), (829, OutOfRange), (22, NotLevelled), (14, DeviceFault), (1291, DeviceRefused)],
)
def test_measuring_reports_what_the_instrument_answered(station, run, code, error):
    async def work(tracker):
        station.codes[FULL] = [code]
        with pytest.raises(error):
            await tracker.measure(1)

    run(work)


def test_the_code_of_the_transport_counts_as_the_code_of_the_procedure(station, run):
    async def work(tracker):
        station.plan[TEMPERATURE] = [lambda number, _line: station.send_answer(number, 0, com=3081)]
        with pytest.raises(DeviceRefused, match="3081"):
            await tracker.health()

    run(work)


def test_all_errors_are_device_errors_with_the_devices_name():
    assert all(
        isinstance(error_of("tracker", number), DeviceError) and error_of("tracker", number).device == "tracker"
        for number in CODES
        if number
    )
