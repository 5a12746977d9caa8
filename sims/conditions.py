"""The conditions of a pose besides its joints."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

REFERENCE_C = 20.0
"""Temperature at which the links have the lengths of the true geometry."""


@final
@dataclass(frozen=True, slots=True)
class Conditions:
    """How a pose was approached, and in what state.

    `directions`: direction of each joint's last motion: 1, −1, or 0 (the middle of its play); none given: all 0.
    `temperature_c`: of all links, °C. `payload_kg`: at the TCP, besides the tool.
    """

    directions: tuple[int, ...] = ()
    temperature_c: float = REFERENCE_C
    payload_kg: float = 0.0


USUAL = Conditions()
