"""The state of the air as GeoCOM takes it: dry and wet bulb temperature and pressure."""

from __future__ import annotations

import math
from typing import Final, final

from geocompy.data import Byte

from cellctl.devices import LimitExceeded, Weather

_BOUNDS: Final = {
    "temperature_c": (-20.0, 60.0, "°C"),
    "pressure_hpa": (500.0, 1100.0, "hPa"),
    "humidity_percent": (0.0, 100.0, "%"),
}
_PSYCHROMETER_PER_K: Final = 6.62e-4
"""Coefficient of a ventilated psychrometer (WMO No. 8)."""


def check(device: str, weather: Weather) -> None:
    """Raises LimitExceeded for air that no workshop has: a sensor is broken, or the units are wrong."""
    for name, (low, high, unit) in _BOUNDS.items():
        value = getattr(weather, name)
        if not low <= value <= high:
            what = f"weather: {name} = {value:g} is outside {low:g} … {high:g} {unit}; nothing was written"
            raise LimitExceeded(device, what, "check the cell's sensors of the air, and their units")


def wet_bulb_c(weather: Weather) -> float:
    """The wet bulb temperature, by bisection of e = e_s(t_w) − A p (t − t_w)."""
    vapour = weather.humidity_percent / 100.0 * _saturation_hpa(weather.temperature_c)
    low, high = weather.temperature_c - 60.0, weather.temperature_c
    for _ in range(50):
        wet = (low + high) / 2.0
        excess = _saturation_hpa(wet) - _PSYCHROMETER_PER_K * weather.pressure_hpa * (weather.temperature_c - wet)
        low, high = (wet, high) if excess < vapour else (low, wet)
    return (low + high) / 2.0


def _saturation_hpa(temperature_c: float) -> float:
    """Vapour pressure over water, Magnus' formula (WMO No. 8)."""
    return 6.112 * math.exp(17.62 * temperature_c / (243.12 + temperature_c))


@final
class Exactly(Byte):
    """A number that geocompy writes as it is. It writes a float with six decimals: a wavelength of 6.58e-7 is lost."""

    def __init__(self, number: float) -> None:
        self._number = number

    def __str__(self) -> str:
        return repr(self._number)
