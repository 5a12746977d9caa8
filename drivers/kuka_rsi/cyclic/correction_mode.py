"""Absolute and relative corrections: the meaning of the values after `RSI_ON(#ABSOLUTE)` and `RSI_ON(#RELATIVE)`."""

from __future__ import annotations

import math
from enum import StrEnum
from typing import final

from drivers.kuka_rsi.axes import AXES
from drivers.kuka_rsi.cyclic.limits import Correction
from drivers.kuka_rsi.cyclic.telegram import DECIMALS


@final
class CorrectionMode(StrEnum):
    """How the controller's program switches RSI on; the address must agree."""

    ABSOLUTE = "absolute"
    """Each cycle's value is the offset from the pose at RSI_ON; zero returns to it."""

    RELATIVE = "relative"
    """Each cycle's value is added to the sum of those before; zero is standstill."""

    @property
    def holdon(self) -> str:
        """The only HOLDON of the six corrections that stops the robot after a missing answer.

        Absolute and 0: the output falls to zero, a leap back to the start. Relative and 1: the last increment is added
        again in every cycle.
        """
        return "1" if self is CorrectionMode.ABSOLUTE else "0"


@final
class WrittenCorrections:
    """The values to write in each cycle so that the set-point is at a given offset from the pose at RSI_ON.

    Relative: the offset less the sum written so far, as rounded on the wire, so that roundings do not accumulate.
    An increment in a late answer is lost and not repeated: the controller's sum lags behind ours, and the
    robot stops short of a limit, never beyond. `short_deg`: its largest lag, as length of the path.
    """

    def __init__(self, mode: CorrectionMode) -> None:
        self._mode = mode
        self._sum: Correction = (0.0,) * AXES
        self._last: Correction = (0.0,) * AXES
        self.short_deg = 0.0

    def leading_to(self, offset: Correction) -> Correction:
        """The values of A1…A6 to write now, degrees."""
        if self._mode is CorrectionMode.ABSOLUTE:
            return offset
        # + 0.0: no minus sign before a zero
        steps = tuple(round(to - at, DECIMALS) + 0.0 for to, at in zip(offset, self._sum, strict=True))
        self._sum = tuple(at + step for at, step in zip(self._sum, steps, strict=True))
        self._last = steps
        return steps

    def not_taken(self) -> None:
        """The controller may not have taken the last values."""
        self.short_deg += math.hypot(*self._last)
