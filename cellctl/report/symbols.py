"""Parameters as a metrologist writes them: `θ2`, `tool X`, `A2 sag by link 3, x`; and the units to show them in."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from typing import Final

_GREEK: Final = {"theta": "θ", "alpha": "α", "beta": "β"}

_WORDS: Final[tuple[tuple[str, Callable[[re.Match[str]], str]], ...]] = (
    (r"tool_deflection", lambda found: "tool deflection c_t"),
    (r"(base|tool)_([xyzabc])(?:@(.*))?", lambda found: _frame(*found.groups())),
    (r"(theta|alpha|beta|d|a)(\d+)", lambda found: f"{_GREEK.get(found[1], found[1])}{found[2]}"),
    (r"turn_([xy])(\d+)", lambda found: f"axis {found[2]} tilt {found[1]}"),
    (r"slide_([xy])(\d+)", lambda found: f"axis {found[2]} place {found[1]}"),
    (r"compliance(\d+)_(\d+)([xy])", lambda found: f"A{found[1]} sag by link {found[2]}, {found[3]}"),
    (r"compliance_load(\d+)", lambda found: f"A{found[1]} sag by payload"),
    (r"harmonic(\d+)_([sc])(\d+)", lambda found: f"A{found[1]} {'sin' if found[2] == 's' else 'cos'} {found[3]}q"),
    (r"backlash(\d+)", lambda found: f"A{found[1]} half play"),
    (r"growth(\d+)", lambda found: f"link {found[1]} growth"),
    (r"(.+)_plane_([xyz])", lambda found: f"plane {found[1]} {found[2].upper()}"),
    (r"(.+)_([xyz])", lambda found: f"{found[1]} {found[2].upper()}"),
)

_SHOWN: Final = {
    "mm": ("mm", 1.0),
    "rad": ("°", math.degrees(1.0)),
    "1/(N m^2)": ("1/(N·m²)", 1.0),
    "rad/(N m)": ("µrad/(N·m)", 1e6),
    "1/K": ("µm/(m·K)", 1e6),
}


def symbol(name: str) -> str:
    """`theta2` → `θ2`, `tool_x@cell B` → `tool X, cell B`, `S1_x` → `S1 X`; an unknown name as it is."""
    for pattern, words in _WORDS:
        if found := re.fullmatch(pattern, name):
            return words(found)
    return name


def shown_unit(unit: str) -> tuple[str, float]:
    """The unit that a parameter of `unit` is shown in, and the factor to it. Unknown ones stay as they are."""
    return _SHOWN.get(unit, (unit, 1.0))


def _frame(frame: str, axis: str, session: str | None) -> str:
    return f"{frame} {axis.upper()}{f', {session}' if session else ''}"
