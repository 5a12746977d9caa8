"""Recorded points as arrays for the mathematics."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cellctl.devices import MeasuredPoint
from cellctl.metrology.points import Points, beam_directions

AIMING_MM = {"tdra6000": 0.05}
"""Accuracy profile → 1 σ across the beam of the target recognition's pointing, on each axis, mm. It is new at each aim;
the point's own covariance, which is of its samples after one aim, lacks it."""


def points_of(measured: Sequence[MeasuredPoint]) -> Points:
    """Points of one set-up of the instrument, each aimed at anew, with their covariances."""
    xyz = np.array([each.xyz for each in measured])
    aiming = np.array([AIMING_MM.get(each.accuracy, 0.0) for each in measured])
    beams = beam_directions(xyz)
    across = np.eye(3) - beams[:, :, :1] @ np.swapaxes(beams[:, :, :1], 1, 2)
    return Points.of(
        xyz,
        np.array([each.covariance for each in measured]) + aiming[:, None, None] ** 2 * across,
        np.array([each.common for each in measured]),
    )
