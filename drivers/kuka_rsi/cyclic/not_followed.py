"""Checks, while the program stands, that the reported joints are the programmed ones with the correction sent."""

from __future__ import annotations

import math
from typing import final

from drivers.kuka_rsi.cyclic.following import LONGEST_LAG_S, NOISE_DEG
from drivers.kuka_rsi.cyclic.limits import Correction
from drivers.kuka_rsi.cyclic.telegram import Telegram

_STANDS_S = 0.5
"""The program has stood for so long: the servo's lag and the shift of AIPos's source are over."""


@final
class NotFollowed:
    """In motion the reported joints lag by an unknown time; at rest they tell whether the correction has its effect.

    AXISCORR clamps silently, a context may be wired to other channels, and RSI_ON(#RELATIVE) sums up offsets. The
    correction begins at rest: sums are noticed in the first tenths of a degree.
    """

    def __init__(self, cycle_s: float) -> None:
        self._stood_most = math.ceil(_STANDS_S / cycle_s)
        self._lag_cycles = math.ceil(LONGEST_LAG_S / cycle_s)
        self._stood = self._stood_most
        self._programmed: tuple[float, ...] | None = None
        self._recent: list[Correction] = []

    def look(self, telegram: Telegram, sent: Correction) -> bool:
        """Whether an axis at rest is elsewhere than any correction sent within the longest lag would bring it."""
        self._recent = [*self._recent[-self._lag_cycles :], sent]
        programmed = telegram.programmed
        self._stood = self._stood + 1 if programmed == (self._programmed or programmed) else 0
        self._programmed = programmed
        if programmed is None or self._stood < self._stood_most:
            return False
        allowed = NOISE_DEG + 2 * telegram.resolution_deg
        rows = zip(telegram.joints, programmed, zip(*self._recent, strict=True), strict=True)
        return any(not min(each) - allowed <= joint - at <= max(each) + allowed for joint, at, each in rows)
