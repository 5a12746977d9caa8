"""What a cell's controllers hold: inputs and outputs, conditions of interlocks, motor currents, variables, files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol, final, runtime_checkable

from cellctl.devices._points import Weather
from cellctl.devices._protocols import Device, observes


@runtime_checkable
class Conditions(Protocol):
    """A device that reports whether conditions hold: a door is closed, the drives are ready, a line is alive."""

    def conditions(self) -> Mapping[str, str]:
        """Each condition's name, with its meaning: `{"whole": "the loop is open or closed, not broken"}`.

        Known before `connect`; a name may be any text, `input(door_closed)` too.
        """

    async def holds(self, condition: str) -> bool:
        """Whether the condition holds now; called often, so it must be fast. Raises DeviceError, KeyError."""


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


@final
@dataclass(frozen=True, slots=True)
class MotorCurrents:
    """Mean currents of A1…An at rest, amperes, with scale and offset of the cell file applied.

    A driver returns them in its controller's own unit, which may be another (MACur of RSI has none published); the
    campaign's step applies scale and offset.

    sigma_a: 1 σ of one sample; samples: how many; time_ns: the cell's time in the middle of them.
    """

    amperes: tuple[float, ...]
    sigma_a: tuple[float, ...]
    samples: int
    time_ns: int


@observes
@runtime_checkable
class CurrentSource(Device, Protocol):
    """A device that reads the motor currents of the robot's axes."""

    async def currents(self, samples: int) -> MotorCurrents:
        """Sample all axes at the same instants, `samples` times; before the brakes close. Raises DeviceFault (a drive
        is not operational, EMCY), DeviceLost (no data)."""


@runtime_checkable
class VariableStore(Device, Protocol):
    """A controller whose variables can be read and written. Values are text in the controller's own language."""

    async def read_variable(self, name: str) -> str:
        """The value of a variable: `"{E6AXIS: A1 0.0, …}"`. Raises DeviceRefused, DeviceFault, DeviceLost."""

    async def write_variable(self, name: str, value: str) -> None:
        """Write a variable, read it back and compare.

        Raises DeviceRefused (no such variable, or one that moves the robot), DeviceFault (they differ), DeviceLost.
        """


@runtime_checkable
class FileStore(Device, Protocol):
    """A controller whose files can be read and written, by paths as it has them."""

    async def read_file(self, path: str) -> bytes:
        """The content of a file. Raises DeviceRefused, DeviceFault, DeviceLost."""

    async def write_file(self, path: str, content: bytes) -> None:
        """Write a file, read it back and compare. Raises DeviceRefused, DeviceFault (they differ), DeviceLost."""
