"""Lines that prove that the probe is alive: only those newer than all earlier ones, with their times."""

from __future__ import annotations

from typing import final

from drivers.contact_probe.lines import Line
from drivers.contact_probe.messages import Boot, Heartbeat, Introduction
from drivers.contact_probe.ticks import LONGEST_GAP_NS, WRAP, TickClock

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
