"""Registers, digital and analogue inputs and outputs, payload: what programs and RTDE read and write."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import final

NUMBERS = 48
BITS = 128
DIGITAL = 18
"""0 to 7 standard, 8 to 15 configurable, 16 and 17 at the tool."""
STANDARD, CONFIGURABLE, TOOL = (0, 8), (8, 8), (16, 2)
"""First bit and count of each kind of digital input and output."""


@final
@dataclass(slots=True)
class Registers:
    """General purpose registers of one direction."""

    bits: list[bool] = field(default_factory=lambda: [False] * BITS)
    ints: list[int] = field(default_factory=lambda: [0] * NUMBERS)
    doubles: list[float] = field(default_factory=lambda: [0.0] * NUMBERS)

    def word(self, first: int) -> int:
        """32 bits from `first` on, as a number."""
        return sum(1 << i for i in range(32) if self.bits[first + i])

    def set_word(self, first: int, word: int) -> None:
        """Set them."""
        self.bits[first : first + 32] = [bool(word >> i & 1) for i in range(32)]


@final
@dataclass(slots=True)
class Payload:
    """kg; centre of gravity in the flange frame, m; inertia about it, kg m²: Ixx, Iyy, Izz, Ixy, Ixz, Iyz."""

    mass: float = 0.0
    cog: tuple[float, ...] = (0.0,) * 3
    inertia: tuple[float, ...] = (0.0,) * 6


@final
@dataclass(slots=True)
class Board:
    """What is lost when the controller restarts. Analogue outputs are shares of their range, 0 … 1."""

    inputs: Registers = field(default_factory=Registers)
    outputs: Registers = field(default_factory=Registers)
    digital_out: int = 0
    analog_out: list[float] = field(default_factory=lambda: [0.0, 0.0])
    analog_out_voltage: list[bool] = field(default_factory=lambda: [False, False])
    tool_voltage: int = 0
    payload: Payload = field(default_factory=Payload)

    def set_digital(self, mask: int, value: int, first: int = 0, count: int = DIGITAL) -> None:
        """Set those outputs, from `first` on, that `mask` names."""
        mask &= (1 << count) - 1
        self.digital_out = (self.digital_out & ~(mask << first)) | ((value & mask) << first)

    def analog_value(self, which: int) -> float:
        """As RTDE and the interfaces show it: A, 4 to 20 mA, or V, 0 to 10."""
        share = self.analog_out[which]
        return share * 10.0 if self.analog_out_voltage[which] else 0.004 + share * 0.016

    def set_analog(self, which: int, share: float, *, voltage: bool | None = None) -> None:
        """Set an output to a share of its range, as current or voltage; None: as it is."""
        self.analog_out[which] = min(max(share, 0.0), 1.0)
        if voltage is not None:
            self.analog_out_voltage[which] = voltage
