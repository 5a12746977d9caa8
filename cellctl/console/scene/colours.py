"""Colours of residuals: viridis over the logarithm, dark for large. Readable with every kind of colour blindness."""

from __future__ import annotations

import numpy as np

from cellctl.kinematics import Floats

LEAST_MM, MOST_MM = 0.01, 10.0
"""Ends of the scale, the same in every run: colours can be compared, and do not change while a run goes on."""

TICKS_MM = (0.01, 0.1, 1.0, 10.0)

_VIRIDIS = ("#addc30", "#5ec962", "#28ae80", "#21918c", "#2c728e", "#3b528b", "#472d7b", "#440154")
"""matplotlib's viridis at 0.875, 0.75, …, 0: without its end in light yellow, which a light ground hides."""

UNKNOWN = "#8d96a0"
"""A point without a known residual."""

COMING = "#6b7580"
"""The outline of a point that is still to be measured."""

RGB = tuple[float, float, float]


def rgb(colour: str) -> RGB:
    """Red, green, blue from 0 to 1 of `#rrggbb` (sRGB)."""
    red, green, blue = (int(colour[at : at + 2], 16) / 255.0 for at in (1, 3, 5))
    return red, green, blue


_TABLE = np.array([rgb(colour) for colour in _VIRIDIS])


def residual_colours(residual: Floats) -> Floats:
    """Colours (N, 3), sRGB from 0 to 1, of residuals (N,), mm; NaN has the colour UNKNOWN."""
    known = np.isfinite(residual)
    size = np.clip(np.where(known, np.abs(residual), LEAST_MM), LEAST_MM, MOST_MM)
    share = np.log10(size / LEAST_MM) / np.log10(MOST_MM / LEAST_MM)
    at = np.linspace(0.0, 1.0, len(_TABLE))
    colours = np.stack([np.interp(share, at, channel) for channel in _TABLE.T], axis=-1)
    return np.where(known[:, None], colours, rgb(UNKNOWN))


def gradient() -> str:
    """The scale as a CSS gradient, least to most."""
    return f"linear-gradient(to right, {', '.join(_VIRIDIS)})"
