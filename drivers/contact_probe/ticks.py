"""The probe's hardware count on the cell's clock with its uncertainty, and lines that prove that the probe is alive."""

from __future__ import annotations

import math
from collections import deque
from typing import final

from cellctl.clock import DelayFit, MinimumDelayFit
from drivers.contact_probe.lines import Boot, Heartbeat, Introduction, Line

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


_HALF_THE_NUMBERS = 0x8000
_DRIFT = 3e-4
"""Clocks that differ by more than this (300 ppm) are wrong; the map of ticks has the same limit."""
_SETTLED_NS = 1_000_000_000
"""Window whose line with the least delay gives the current count."""
_AHEAD_NS = 200_000_000
"""A count further ahead than this has jumped, or runs fast."""
_LATE_NS = 50_000_000
"""Least delay that is reported when the proofs of life are too old."""


@final
class Liveness:
    """Judges each line of one connection, in order of arrival. Pure; for one thread.

    A line is new if its count has advanced and, for a heartbeat, its number, too: the probe takes the count when it
    begins to send, so this holds for repeated lines, too. `BOOT` and a long silence restart both.
    """

    def __init__(self) -> None:
        self.reason = ""
        """Why the last line was no proof of life, or an old one; empty if it was valid."""
        self._tick_hz = 0
        self._heard_ns = 0
        self._begin()

    def lateness_ns(self, line: Line, time_ns: int, *, double: bool) -> int | None:
        """Extra delay of `line`, read at `time_ns`, over the fastest lines; None if it is not new.

        `double`: the line is a repetition of a received one. It can be new (the probe sent it again), but repetitions
        alone do not prove life: the caller decides.
        """
        if (isinstance(line.message, Boot) and not double) or time_ns - self._heard_ns > LONGEST_GAP_NS:
            self._begin()
        self._heard_ns = time_ns
        if isinstance(line.message, Introduction):
            self._tick_hz = line.message.tick_hz
        self.reason = self._why_old(line) or self._why_ahead(line, time_ns)
        if self.reason:
            return None
        late_ns = self._advance(line, time_ns)
        if double:
            self.reason = f"line {line.seq} again"
        elif late_ns > _LATE_NS:
            self.reason = f"by the probe's clock, its lines come {late_ns / 1e6:.0f} ms late"
        return late_ns

    def _begin(self) -> None:
        self._tick: int | None = None
        self._beat_seq: int | None = None
        self._device_ns = 0
        self._fastest_ns: float | None = None  # arrival less count, of the fastest line
        self._bound_ns = 0.0  # the same in the first second, with drift: a value far below has jumped

    def _why_old(self, line: Line) -> str:
        if self._tick == line.tick:
            return f"its clock stands still at {line.tick}"
        if self._tick is not None and TickClock.is_before(line.tick, self._tick):
            return f"an old line again, of tick {line.tick} after {self._tick}"
        beat, before = isinstance(line.message, Heartbeat), self._beat_seq
        if beat and before is not None and not 0 < (line.seq - before) % 0x10000 < _HALF_THE_NUMBERS:
            return f"heartbeat {line.seq} after heartbeat {before}"
        return ""

    def _why_ahead(self, line: Line, time_ns: int) -> str:
        if self._fastest_ns is None or self._device_ns < _SETTLED_NS:
            return ""
        step_ns = self._step_ns(line)
        ahead_ns = self._bound_ns - _DRIFT * step_ns - (time_ns - self._device_ns - step_ns)
        return f"its clock is {ahead_ns / 1e6:.0f} ms ahead of its lines before" if ahead_ns > _AHEAD_NS else ""

    def _advance(self, line: Line, time_ns: int) -> int:
        step_ns = self._step_ns(line)
        self._tick = line.tick
        if isinstance(line.message, Heartbeat):
            self._beat_seq = line.seq
        if not self._tick_hz:
            return 0
        settled = self._device_ns >= _SETTLED_NS
        self._device_ns += step_ns
        offset_ns = time_ns - self._device_ns
        before_ns = offset_ns if self._fastest_ns is None else self._fastest_ns
        self._fastest_ns = min(offset_ns, before_ns + _DRIFT * step_ns)
        self._bound_ns = self._bound_ns - _DRIFT * step_ns if settled else self._fastest_ns
        return round(offset_ns - self._fastest_ns)

    def _step_ns(self, line: Line) -> int:
        if self._tick is None or not self._tick_hz:
            return 0
        return (line.tick - self._tick) % WRAP * 1_000_000_000 // self._tick_hz
