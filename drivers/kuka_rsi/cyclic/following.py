"""Checks that the reported joints follow: the set-points of a search, or the programmed joints with the correction."""

from __future__ import annotations

import math
from collections import deque
from enum import Enum, auto
from operator import mul, sub
from typing import final

from drivers.kuka_rsi.cyclic.limits import Correction
from drivers.kuka_rsi.cyclic.telegram import Telegram

LONGEST_LAG_S = 0.15
"""Longest time after which joints that follow reach a set-point: 24 ms of servo (the simulated one's; not measured on a
KRC), 100 ms by which AIPos may be shifted (RSI's source `IPO` is that far ahead of the drives), and two cycles of 12
ms. Longer is safe but slow: a robot that ignores its answers goes undetected for so long.
"""

NOISE_DEG = 0.02
"""In addition to the telegram's last decimal: encoder noise, and friction that holds an axis back at small speeds. 0.02
deg is 0.5 mm at 1.5 m; an estimate, to be replaced by a measurement."""

_FARTHEST_ASTRAY_DEG = 0.25
"""Ahead of the set-point, or beside the line. No servo leads, and a telegram may show steps of 0.1 deg."""


class Follows(Enum):
    """The findings from the reported joints."""

    YES = auto()
    BEHIND = auto()
    AHEAD = auto()


@final
class Following:
    """Compares the joints of each telegram with the set-points sent, along the line and axis by axis.

    A robot that follows is between the set-point of `LONGEST_LAG_S` ago and the last one. So if a controller ignores
    every answer and then takes one, an axis jumps by at most its speed × (`LONGEST_LAG_S` + four cycles) +
    `NOISE_DEG` + twice the telegram's resolution (2 deg/s, 4 ms, four decimals: 0.36 deg).
    `start`: reported joints at the start; `line`: offset at the line's end; degrees.
    """

    def __init__(self, start: tuple[float, ...], line: Correction, step_deg: float, lag_count: int) -> None:
        length = math.hypot(*line) or 1.0
        self._start = start
        self._along = tuple(axis / length for axis in line)
        self._axes = [(math.copysign(1, share), abs(share)) for share in self._along]
        self._step = step_deg
        self._lag = lag_count
        self._sent: deque[tuple[int, float]] = deque()

    def sent(self, ipoc: int, place_deg: float) -> None:
        """The telegram `ipoc` was answered with the set-point at `place_deg` of the line."""
        self._sent.append((ipoc, place_deg))

    def look(self, telegram: Telegram, short_deg: float) -> Follows:
        """The finding for the joints; `short_deg` of the path may be lost in increments not taken."""
        if not self._sent:
            return Follows.YES
        while len(self._sent) > 1 and self._sent[1][0] <= telegram.ipoc - self._lag:
            self._sent.popleft()
        low, high = max(0.0, self._sent[0][1] - short_deg), self._sent[-1][1]
        away = list(map(sub, telegram.joints, self._start))
        if sum(map(mul, away, self._along)) - high > _FARTHEST_ASTRAY_DEG:
            return Follows.AHEAD
        behind = NOISE_DEG + telegram.resolution_deg + self._step
        for off, (sense, share) in zip(away, self._axes, strict=True):
            gone, due, most = sense * off, low * share, high * share
            if due - gone > (behind if share else _FARTHEST_ASTRAY_DEG) or gone - most > _FARTHEST_ASTRAY_DEG:
                return Follows.BEHIND
        return Follows.YES


_STANDS_S = 0.5
"""The program has stood for so long: the servo's lag and the shift of AIPos's source are over, thrice
`LONGEST_LAG_S`."""


@final
class NotFollowed:
    """In motion the reported joints lag by an unknown time; at rest they tell whether the correction has its effect.

    AXISCORR clamps silently, a context may be wired to other channels, and RSI_ON(#RELATIVE) sums up offsets. The
    correction begins at rest: sums are noticed in the first tenths of a degree.
    """

    def __init__(self, cycle_s: float) -> None:
        self._stood_most = math.ceil(_STANDS_S / cycle_s)
        self._lag_cycles = math.ceil(LONGEST_LAG_S / cycle_s)
        self._stood = self._stood_most  # it begins at rest: CORRON is refused while the program moves
        self._programmed: tuple[float, ...] | None = None
        self._recent: list[Correction] = []

    def look(self, telegram: Telegram, sent: Correction) -> bool:
        """Whether an axis at rest is elsewhere than any correction sent within the longest lag would bring it."""
        self._recent = [*self._recent[-self._lag_cycles :], sent]
        programmed = telegram.programmed
        # exactly: at rest the program's joints repeat every decimal
        self._stood = self._stood + 1 if programmed == (self._programmed or programmed) else 0
        self._programmed = programmed
        if programmed is None or self._stood < self._stood_most:
            return False
        allowed = NOISE_DEG + 2 * telegram.resolution_deg
        rows = zip(telegram.joints, programmed, zip(*self._recent, strict=True), strict=True)
        return any(not min(each) - allowed <= joint - at <= max(each) + allowed for joint, at, each in rows)
