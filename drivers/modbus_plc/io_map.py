"""The I/O map: what each address of the PLC means (docs/connecting-a-plc.md). Pure; addresses count from 0."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, final

WordOrder = Literal["high_first", "low_first"]
"""Which word of a 32-bit value has the lower address."""

INPUTS = {
    "emergency_stop_ok": "the emergency stop chain is closed",
    "guard_closed": "the guard door is closed",
    "guard_locked": "the guard door is locked",
    "safety_reset_required": "the safety chain waits for its reset",
    "air_pressure_ok": "the air pressure is in order",
    "clamped": "the tool is clamped",
    "unclamped": "the tool is unclamped",
    "tool_present": "a tool is present",
    "drives_on": "the robot's drives are on",
    "mode_auto": "the key switch is at AUTO",
    "torch_cleaner_home": "the torch cleaner is at home",
    "sphere_cover_open": "the cover of the spheres is open",
    "tracker_power_ok": "the tracker has power",
    "maintenance_switch": "the maintenance switch is on",
}
"""Discrete inputs, by address, with their meanings when they are 1."""

OUTPUTS = (
    "door_lock",
    "clamp",
    "unclamp",
    "air_valve",
    "lamp_green",
    "lamp_amber",
    "horn",
    "tracker_shutter",
    "fault_reset",
)
"""Coils, by address."""

EXCLUSIVE = {"clamp": "unclamp", "unclamp": "clamp"}
"""Outputs that must not be set together."""

REGISTERS = 11
"""Number of input registers."""

PC_HEARTBEAT = 0
"""Holding register that the computer changes with each poll."""

BROKEN = 0x8000
"""A register with this value belongs to a broken sensor."""


@final
@dataclass(frozen=True, slots=True)
class Readings:
    """The input registers. °C, hPa, %, bar, s; None: that sensor is broken. `counter`: the PLC's heartbeat."""

    air_c: float | None
    base_c: float | None
    arm_c: float | None
    fixture_c: float | None
    pressure_hpa: float | None
    humidity_percent: float | None
    supply_bar: float
    counter: int
    uptime_s: int
    fault_code: int

    def broken(self) -> list[str]:
        """The broken sensors by name."""
        sensors = {
            "air temperature": self.air_c,
            "base temperature": self.base_c,
            "arm temperature": self.arm_c,
            "fixture temperature": self.fixture_c,
            "pressure": self.pressure_hpa,
            "humidity": self.humidity_percent,
        }
        return [name for name, value in sensors.items() if value is None]


def readings(registers: Sequence[int], words: WordOrder) -> Readings:
    """The eleven input registers as values."""
    high, low = registers[8:10] if words == "high_first" else registers[9:7:-1]
    return Readings(
        air_c=_tenths(_signed(registers[0])),
        base_c=_tenths(_signed(registers[1])),
        arm_c=_tenths(_signed(registers[2])),
        fixture_c=_tenths(_signed(registers[3])),
        pressure_hpa=_tenths(registers[4]),
        humidity_percent=_tenths(registers[5]),
        supply_bar=registers[6] / 100.0,
        counter=registers[7],
        uptime_s=high << 16 | low,
        fault_code=registers[10],
    )


def named_inputs(bits: Sequence[bool]) -> dict[str, bool]:
    """The discrete inputs by name; a library pads them to whole bytes."""
    return {name: bool(bit) for name, bit in zip(INPUTS, bits, strict=False)}


def _signed(register: int) -> int:
    """The register as INT16; the mark of a broken sensor stays as it is."""
    return register - 0x10000 if register > BROKEN else register


def _tenths(value: int) -> float | None:
    return None if value == BROKEN else value / 10.0
