"""What changes with use: the tip wears away, and the links grow as the robot warms up."""

from __future__ import annotations

from collections.abc import Mapping
from math import expm1, isfinite
from typing import Any, final

WEAR_MM = 0.0005
"""Of the wire, at each touch."""
WARM_UP_MM = 0.08
"""Thermal expansion of the stretched links in the end: about the drift of a robot of this class in its first hour."""
WARM_UP_S = 1200.0
PER_K = 1.75e-5
"""Mean expansion of an arm of steel and aluminium, per kelvin: its rise of temperature by its expansion."""


@final
class Ageing:
    """A fresh tip and cold links at first.

    `wear`, `warm_up`: the errors' scales; `links_mm`: the links stretched out, base to flange. `worn_mm`: how much
    shorter the tip is, along the flange's z. `expansion`: by what share the links are longer.
    """

    def __init__(self, wear: float, warm_up: float, links_mm: float) -> None:
        self.worn_mm = 0.0
        self.expansion = 0.0
        self._wear_mm = wear * WEAR_MM
        self._full_expansion = warm_up * WARM_UP_MM / links_mm
        self._on_before_ns = 0

    def touched(self) -> None:
        """The tip has touched, and is off again."""
        self.worn_mm += self._wear_mm

    def shorten(self, mm: float) -> None:
        """The tip has been bent or cut."""
        self.worn_mm += mm

    def warm(self, time_ns: int) -> None:
        """The robot has been on until this time of the cell, cold at 0 unless it remembers having been on before."""
        self.expansion = self._expansion_at(time_ns)

    def on_ns(self, time_ns: int) -> int:
        """How long the robot has been on at this time of the cell, with all that it remembers of before."""
        return self._on_before_ns + time_ns

    def rise_k(self, time_ns: int) -> float:
        """By how much the arm is warmer than its surroundings: what makes its links so much longer."""
        return self._expansion_at(time_ns) / PER_K

    def _expansion_at(self, time_ns: int) -> float:
        if not self._full_expansion:
            return 0.0
        return self._full_expansion * -expm1(-self.on_ns(time_ns) * 1e-9 / WARM_UP_S)

    def state(self, time_ns: int) -> dict[str, Any]:
        """The state to keep, as JSON."""
        return {"worn_mm": self.worn_mm, "on_ns": self.on_ns(time_ns)}

    def recall(self, state: Mapping[str, Any]) -> None:
        """Continue from a `state` that was kept. Raises ValueError, TypeError, LookupError."""
        worn_mm, on_ns = float(state["worn_mm"]), int(state["on_ns"])
        if not isfinite(worn_mm):
            raise ValueError(f"worn_mm is {worn_mm}")
        self.worn_mm, self._on_before_ns = worn_mm, on_ns
