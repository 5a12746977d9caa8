"""What temperature and use change: air of the cell, links that warm up and grow, a tip that wears away."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import atan, expm1, isfinite, pi, sin, sqrt
from typing import Any, final

import numpy as np

from sims.conditions import REFERENCE_C
from sims.world.errors import generator
from sims.world.kinematics import Axis, Geometry, vector

AIR_K = 1.5
"""Amplitude of the air's temperature over a day: a heated workshop."""
PRESSURE_HPA, PRESSURE_SWING_HPA = 1013.25, 4.0
HUMIDITY_PERCENT, HUMIDITY_PERCENT_PER_K = 45.0, -2.0
DAY_S = 86400.0
LAG_S = 7200.0
"""Time constant with which castings and fixtures follow the air."""
BASE_SHARE = 0.3
"""Of the arm's warming that reaches the robot's base frame."""


@final
@dataclass(frozen=True, slots=True)
class Environment:
    """True temperatures (°C) of air, arm, the robot's base and the fixture; pressure (hPa), relative humidity (%)."""

    air_c: float
    arm_c: float
    base_c: float
    fixture_c: float
    pressure_hpa: float
    humidity_percent: float


@final
class Surroundings:
    """The daily curve of one seed. `scale` 0: 20 °C and standard pressure at all times."""

    def __init__(self, seed: int, scale: float) -> None:
        random = generator(seed, "air")
        self._scale = scale
        self._phase, self._pressure_phase = (float(phase) for phase in random.uniform(-pi, pi, 2))

    def at(self, on_ns: int, arm_rise_k: float) -> Environment:
        """After the cell has been on for `on_ns`; `arm_rise_k`: by how much the arm is warmer than its surroundings."""
        day = 2.0 * pi / DAY_S * on_ns * 1e-9
        lag = 2.0 * pi / DAY_S * LAG_S
        air_k = self._scale * AIR_K * sin(day + self._phase)
        solid_k = self._scale * AIR_K * sin(day + self._phase - atan(lag)) / sqrt(1.0 + lag * lag)
        return Environment(
            air_c=REFERENCE_C + air_k,
            arm_c=REFERENCE_C + solid_k + arm_rise_k,
            base_c=REFERENCE_C + solid_k + BASE_SHARE * arm_rise_k,
            fixture_c=REFERENCE_C + solid_k,
            pressure_hpa=PRESSURE_HPA + self._scale * PRESSURE_SWING_HPA * sin(day + self._pressure_phase),
            humidity_percent=HUMIDITY_PERCENT + HUMIDITY_PERCENT_PER_K * air_k,
        )


STEEL_PER_K = 1.2e-5
ALUMINIUM_PER_K = 2.3e-5


def expansions(links: int, seed: int, scale: float) -> list[float]:
    """Expansion of each link per kelvin."""
    drawn = generator(seed, "expansion").uniform(STEEL_PER_K, ALUMINIUM_PER_K, links)
    return [float(one) for one in scale * drawn]


def grown(cold: Geometry, per_kelvin: Sequence[float], temperature_c: float) -> Geometry:
    """The geometry at a temperature: from each axis the next one, or the flange, is farther by that link's expansion.

    What carries the first axis is the cell's floor: it does not grow. Neither do directions change, nor the tool.
    """
    kelvin = temperature_c - REFERENCE_C
    stations = [np.array(axis.point) for axis in cold.axes] + [cold.flange[:3, 3]]
    places = stations[:1]
    for (start, end), rate in zip(pairwise(stations), per_kelvin, strict=True):
        places.append(places[-1] + (1.0 + rate * kelvin) * (end - start))
    flange = cold.flange.copy()
    flange[:3, 3] = places[-1]
    axes = [Axis(vector(place), axis.direction) for place, axis in zip(places[:-1], cold.axes, strict=True)]
    return Geometry(tuple(axes), flange)


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
