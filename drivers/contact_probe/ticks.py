"""Maps the probe's hardware count to the cell's clock, with its uncertainty."""

from __future__ import annotations

import math
from collections import deque
from typing import final

from cellctl.clock import DelayFit, MinimumDelayFit

WRAP = 1 << 32
"""The count wraps to 0 here."""
LONGEST_GAP_NS = 60_000_000_000
"""After a longer silence the count may have wrapped unnoticed (every 36 min at 2 MHz): restart the fit."""


@final
class TickClock:
    """Unwraps the 32-bit count and fits it to the cell's clock by the lines with the least delay.

    A delay common to all lines is unobservable from arrivals; it is in the fit's offset. SYNC bounds it: the probe
    cannot receive a command before it was sent, so the map is late by at most the time from sending to the mapped
    `received_tick`. The smallest of the last bounds counts.
    """

    def __init__(self, tick_hz: int) -> None:
        self._tick_hz = tick_hz
        self._fit = MinimumDelayFit()
        self._bounds: deque[float] = deque(maxlen=16)
        self.restart()

    def restart(self) -> None:
        """The count restarted: discard the map. The adapter's delay is unchanged."""
        self._fit.clear()
        self._last: int | None = None
        self._last_arrival_ns = 0
        self._first_ns = 0

    def add_line(self, tick: int, arrival_ns: int, wire_ns: int) -> None:
        """A line begun at `tick` was complete at `arrival_ns` of the cell's clock; transmission took `wire_ns`."""
        if arrival_ns - self._last_arrival_ns > LONGEST_GAP_NS:
            self.restart()
        ticks = self._unwrapped(tick)
        device_ns = self._nanoseconds(ticks)
        if self._last is None:
            self._first_ns = device_ns
        self._last, self._last_arrival_ns = ticks, arrival_ns
        self._fit.add(device_ns, arrival_ns - wire_ns)

    def add_sync(self, received_tick: int, sent_ns: int) -> None:
        """A command that could not arrive completely before `sent_ns` had arrived at `received_tick`."""
        self._bounds.append(max(0.0, self.cell_ns(received_tick) - sent_ns))

    @property
    def last_tick(self) -> int:
        """The 32-bit count of the last line; 0 before the first."""
        return (self._last or 0) % WRAP

    @property
    def span_s(self) -> float:
        """Seconds of the count that the lines so far span."""
        return 0.0 if self._last is None else (self._nanoseconds(self._last) - self._first_ns) * 1e-9

    @property
    def fit(self) -> DelayFit:
        """The map now. Raises ValueError before the first line."""
        return self._fit.fit()

    @property
    def hidden_ns(self) -> float:
        """The largest unobservable delay common to all lines; infinite before the first SYNC."""
        return min(self._bounds, default=math.inf)

    def cell_ns(self, tick: int) -> int:
        """The cell's time at `tick`, which lies within 17 minutes of the last line. Raises ValueError without lines."""
        return self.fit.to_cell_ns(self._nanoseconds(self._unwrapped(tick)))

    @staticmethod
    def is_before(tick: int, other: int) -> bool:
        """Whether the 32-bit count `tick` is older than `other`, both within 17 minutes of each other."""
        return (tick - other) % WRAP >= WRAP // 2

    def sigma_ns(self) -> int:
        """1 σ of `cell_ns`: the envelope's support, the shared delay (uniform up to its bound), the count's step."""
        hidden = self.hidden_ns if math.isfinite(self.hidden_ns) else 0.0
        step = 1e9 / self._tick_hz
        return math.ceil(math.hypot(self.fit.sigma_ns, hidden / math.sqrt(3), step / math.sqrt(12)))

    def _unwrapped(self, tick: int) -> int:
        if self._last is None:
            return tick
        return self._last + (tick - self._last + WRAP // 2) % WRAP - WRAP // 2

    def _nanoseconds(self, ticks: int) -> int:
        return ticks * 1_000_000_000 // self._tick_hz
