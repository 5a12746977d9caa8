"""Motor currents as the controller's own drives show them in RSI telegrams."""

from __future__ import annotations

import random
from collections.abc import Callable
from typing import final

NOISE_A = 0.02
"""1 σ of one telegram's value."""
STEP_A = 0.001


@final
class CurrentDisplay:
    """Amperes of A1…An with noise and resolution; `true`: the mean currents now."""

    def __init__(self, true: Callable[[], tuple[float, ...]], seed: int) -> None:
        self._true = true
        self._random = random.Random(f"{seed} motor currents of the controller")

    def now(self) -> list[float]:
        """Of the present telegram; every call draws anew."""
        return [round((value + self._random.gauss(0.0, NOISE_A)) / STEP_A) * STEP_A for value in self._true()]
