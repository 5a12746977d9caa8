"""Under which circumstances a pose is asked about, besides its joints."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

REFERENCE_C = 20.0
"""Temperature at which the links are as long as the true geometry has them."""


@final
@dataclass(frozen=True, slots=True)
class Conditions:
    """How a pose was approached, and in what state.

    `directions`: which way each joint's reading moved last: 1, −1, or 0 (the middle of its play); none given: all 0.
    `temperature_c`: of all links, °C. `payload_kg`: hung on the tool centre point, besides the tool.
    """

    directions: tuple[int, ...] = ()
    temperature_c: float = REFERENCE_C
    payload_kg: float = 0.0


USUAL = Conditions()
