"""What the PLC's registers mean."""

from __future__ import annotations

import pytest

from drivers.modbus_plc.io_map import INPUTS, OUTPUTS, named_inputs, readings

REGISTERS = [215, 0xFF9C, 0x8001, 0x8000, 0x2794, 0x8000, 612, 7, 0x0001, 0x86A0, 2]


def test_temperatures_are_signed_and_8000_is_a_broken_sensor():
    found = readings(REGISTERS, "high_first")
    assert found.air_c == 21.5
    assert found.base_c == -10.0
    assert found.arm_c == pytest.approx(-3276.7)
    assert found.fixture_c is None
    assert found.pressure_hpa == 1013.2
    assert found.humidity_percent is None
    assert found.supply_bar == 6.12
    assert (found.counter, found.fault_code) == (7, 2)
    assert found.broken() == ["fixture temperature", "humidity"]


def test_the_word_order_of_the_uptime_is_as_declared():
    assert readings(REGISTERS, "high_first").uptime_s == 100_000
    swapped = [*REGISTERS[:8], REGISTERS[9], REGISTERS[8], *REGISTERS[10:]]
    assert readings(swapped, "low_first").uptime_s == 100_000


def test_the_map_is_that_of_the_documents():
    assert list(INPUTS).index("emergency_stop_ok") == 0
    assert list(INPUTS).index("maintenance_switch") == 13
    assert OUTPUTS.index("clamp") == 1
    assert OUTPUTS.index("fault_reset") == 8
    bits = [True] + [False] * 12 + [True, False, False]
    assert [name for name, value in named_inputs(bits).items() if value] == ["emergency_stop_ok", "maintenance_switch"]
