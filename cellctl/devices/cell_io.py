"""The cell's inputs and outputs: safety inputs, clamps, temperatures, weather."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol, final, runtime_checkable

from cellctl.devices.conditions import Conditions
from cellctl.devices.points import Weather
from cellctl.devices.protocols import Device, observes


@final
@dataclass(frozen=True, slots=True)
class Temperatures:
    """°C, at `time_ns` of the cell's time; None: that sensor is broken or absent."""

    air: float | None
    arm: float | None
    base: float | None
    fixture: float | None
    time_ns: int


@observes
@runtime_checkable
class CellReadings(Device, Conditions, Protocol):
    """What the cell's PLC reports. Emergency stop and guard are inputs: nothing here commands them.

    Values older than the driver's poll limit count as unsafe: conditions do not hold then, and reads raise DeviceLost.
    """

    async def inputs(self) -> Mapping[str, bool]:
        """Every input by name: `{"emergency_stop_ok": True, "guard_closed": True, …}`. Raises DeviceLost."""

    async def temperatures(self) -> Temperatures:
        """Temperatures of the cell. Raises DeviceLost."""

    async def weather(self) -> Weather:
        """The air. Raises DeviceFault if one of its sensors is broken, DeviceLost."""


@runtime_checkable
class CellIO(CellReadings, Protocol):
    """The cell's PLC, with the outputs that it sets for others."""

    async def set_output(self, name: str, value: bool) -> None:
        """Set an output by name, and read it back. Raises DeviceRefused, DeviceLost, KeyError."""
