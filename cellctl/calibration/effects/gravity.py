"""Weight on a robot that stands upright: gravity is −z of its base frame."""

from __future__ import annotations

import numpy as np

from cellctl.kinematics import Floats

STANDARD_GRAVITY = 9.80665
"""N/kg."""

DOWN: Floats = np.array([0.0, 0.0, -1.0])
"""ĝ in the base frame of a robot that stands upright."""
