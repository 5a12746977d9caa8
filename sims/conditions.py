"""The conditions of a pose besides its joints."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

REFERENCE_C = 20.0
"""Temperature at which the links have the lengths of the true geometry."""


@final
@dataclass(frozen=True, slots=True)
class Payload:
    """What the robot carries besides its tool.

    `at`: its centre of gravity in the flange frame, mm: hung on the tool there, which it bends. None: at the TCP,
    without bending the tool.
    """

    kg: float = 0.0
    at: tuple[float, float, float] | None = None


@final
@dataclass(frozen=True, slots=True)
class Conditions:
    """How a pose was approached, and in what state.

    `directions`: direction of each joint's last motion: 1, −1, or 0 (the middle of its play); none given: all 0.
    `temperature_c`: of all links, °C. `payload_kg`, `payload_at`: as in `Payload`; None: what the cell's robot carries.
    """

    directions: tuple[int, ...] = ()
    temperature_c: float = REFERENCE_C
    payload_kg: float | None = None
    payload_at: tuple[float, float, float] | None = None


USUAL = Conditions()
