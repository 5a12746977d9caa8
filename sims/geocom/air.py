"""How the air changes a measured distance: the atmospheric correction of the instrument. Pure functions.

Leica TPS1200 user manual, atmospheric corrections: reference atmosphere 12 °C, 1013.25 hPa, 60 %, carrier 658–850 nm:
ppm = 281.8 − (0.29065 p − 4.126e-4 · h · 10^x) / (1 + t / 273.15), x = 7.5 t / (237.3 + t) + 0.7857.
"""

from __future__ import annotations


def saturation_hpa(air_c: float) -> float:
    """Pressure of saturated water vapour over water (Magnus), hPa; the manual's 10^x."""
    return float(10 ** (7.5 * air_c / (237.3 + air_c) + 0.7857))


def ppm(air_c: float, pressure_hpa: float, vapour_hpa: float) -> float:
    """Part of a distance, in millionths, that must be added to what the instrument measures in this air."""
    return 281.8 - (0.29065 * pressure_hpa - 4.126e-2 * vapour_hpa) / (1 + air_c / 273.15)


def vapour_of_humidity(air_c: float, humidity_percent: float) -> float:
    """Partial pressure of water vapour, hPa."""
    return humidity_percent / 100 * saturation_hpa(air_c)


def vapour_of_wet_bulb(dry_c: float, wet_c: float, pressure_hpa: float) -> float:
    """Partial pressure of water vapour from a psychrometer (Sprung), hPa; never below 0."""
    return max(0.0, saturation_hpa(wet_c) - 6.62e-4 * pressure_hpa * (dry_c - wet_c))


def measured_mm(
    true_mm: float, *, ppm_set: float, ppm_true: float, constant_set_mm: float, constant_true_mm: float
) -> float:
    """The distance that the instrument shows: right where air and constant are set as they are.

    The light travels `true_mm` less the reflector's constant, at the air's true speed.
    """
    return (true_mm - constant_true_mm) * (1 + (ppm_set - ppm_true) * 1e-6) + constant_set_mm
