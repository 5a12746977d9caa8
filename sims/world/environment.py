"""Temperatures and air of the cell: a daily curve, and an arm that warms up while the robot is on."""

from __future__ import annotations

from dataclasses import dataclass
from math import atan, pi, sin, sqrt
from typing import final

from sims.conditions import REFERENCE_C
from sims.world.errors import generator

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
