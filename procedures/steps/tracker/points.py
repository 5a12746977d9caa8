"""Recorded points as arrays for the mathematics."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cellctl.devices import MeasuredPoint
from cellctl.metrology.points import Points


def points_of(measured: Sequence[MeasuredPoint]) -> Points:
    """Points of one set-up of the instrument, with their covariances."""
    return Points.of(
        np.array([each.xyz for each in measured]),
        np.array([each.covariance for each in measured]),
        np.array([each.common for each in measured]),
    )
