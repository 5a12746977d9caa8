"""The probe's hardware count: a crystal that is a little off, started at some moment, wrapping at 32 bits."""

from __future__ import annotations

import random
from typing import Self, final

TICK_HZ = 2_000_000
WORST_PPM = 50.0


@final
class Crystal:
    """Ticks as a function of T: `first` at `zero_ns`, then TICK_HZ · (1 + drift) a second."""

    def __init__(self, drift_ppm: float, first: int, zero_ns: int) -> None:
        self.drift_ppm = drift_ppm
        self._first = first
        self._zero_ns = zero_ns
        self._micro_hz = round(TICK_HZ * (1_000_000 + drift_ppm))

    @classmethod
    def from_seed(cls, seed: int) -> Self:
        """The crystal of this seed's probe, somewhere in its count at T = 0."""
        draw = random.Random(f"{seed} probe crystal")
        return cls(draw.uniform(-WORST_PPM, WORST_PPM), draw.randrange(2**32), 0)

    def restarted(self, now_ns: int) -> Crystal:
        """The same crystal, its count begun anew."""
        return Crystal(self.drift_ppm, 0, now_ns)

    def tick(self, now_ns: int) -> int:
        """The count at `now_ns`."""
        return (self._first + (now_ns - self._zero_ns) * self._micro_hz // 10**15) % 2**32
