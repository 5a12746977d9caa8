"""Postures of the measured region of a model, over which forms and controllers' parameters are fitted to it."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from cellctl.calibration import Postures
    from cellctl.formats.model import ModelFile

DRAWN = 300
"""Postures drawn in the measured region of a model that keeps too few of its own."""
LEAST = 30
SEED = 20_131


def measured_postures(model: ModelFile) -> Postures:
    """Its measured postures, or postures drawn over its joint region where it keeps few.

    The approach of each joint is drawn, and the payload between those of the fit; temperature and currents are unknown.
    """
    import numpy as np

    from cellctl.calibration import Postures

    region, loads, rng = model.joint_region, model.load_region, np.random.default_rng(SEED)
    readings = np.array(region.postures or [])
    if len(readings) < LEAST:
        readings = rng.uniform(region.min, region.max, (DRAWN, model.robot.n))
    approach = rng.choice([-1.0, 1.0], readings.shape)
    payload = rng.uniform(loads.min, loads.max, len(readings)) if loads else None
    at = np.tile(loads.at, (len(readings), 1)) if loads and loads.at else None
    return Postures(model.robot.joint_map().model(readings), approach, payload=payload, payload_at=at)
