"""Direction of gravity in the robot's base, from a levelled instrument and its registration."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np

from cellctl.kinematics import Floats
from cellctl.metrology.measured_pose import MeasuredPose, cross_matrix


@final
@dataclass(frozen=True, eq=False)
class Gravity:
    """direction (3,): unit vector of gravity in the robot's base frame. covariance (3, 3): of rank 2, rad².

    tilt_rad: angle between gravity and the base's −z. sigma_tilt_rad: its standard deviation.
    """

    direction: Floats
    covariance: Floats
    tilt_rad: float
    sigma_tilt_rad: float


def gravity_in_base(station: MeasuredPose, level_sigma_rad: float) -> Gravity:
    """Gravity from the instrument's frame in the base, its z opposite to gravity within `level_sigma_rad` (each axis).

    g = −R z; its covariance [g] (C_ω + σ² (1 − g gᵀ)) [g]ᵀ has the registration's turn and the compensator's error. The
    instrument must be levelled with its compensator on; a registration from axes or points says nothing of gravity.
    """
    down = -station.matrix[:3, 2]
    turns = station.covariance[3:, 3:] + level_sigma_rad**2 * (np.eye(3) - np.outer(down, down))
    change = cross_matrix(down)
    covariance = change @ turns @ change.T
    flat = np.hypot(down[0], down[1])
    heading = down[:2] / flat if flat > 0.0 else np.array([1.0, 0.0])
    along = np.append(-down[2] * heading, flat)  # how gravity's direction moves as the tilt grows
    sigma = np.sqrt(float(along @ covariance @ along))
    return Gravity(down, covariance, float(np.arctan2(flat, -down[2])), float(sigma))
