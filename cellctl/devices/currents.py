"""Motor currents of the robot's axes, from whichever device has them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, final, runtime_checkable

from cellctl.devices.protocols import Device, observes


@final
@dataclass(frozen=True, slots=True)
class MotorCurrents:
    """Mean currents of A1…An at rest, amperes, with scale and offset of the cell file applied.

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
