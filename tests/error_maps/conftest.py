"""A KR5 with errors of links and zeros: its position errors at random postures."""

import numpy as np
import pytest

from tests.helpers.arms import kr5_model

NOISE_MM = 0.01


@pytest.fixture
def measured():
    """Angles (N, 6), rad, up to 40° from a posture in the middle, and errors (N, 3), mm, with noise."""
    model = kr5_model(touches=False)
    nominal = model.robot.chain()
    values = dict(zip((each.name for each in model.parameters), (each.value for each in model.parameters), strict=True))
    actual = nominal.with_parameters([values[name] for name in nominal.parameters])

    def at(count, seed):
        rng = np.random.default_rng(seed)
        q = np.deg2rad([0.0, -60.0, 80.0, 10.0, 60.0, 20.0]) + np.deg2rad(rng.uniform(-40.0, 40.0, (count, 6)))
        away = actual.forward(q)[:, :3, 3] - nominal.forward(q)[:, :3, 3]
        return q, away + NOISE_MM * rng.standard_normal(away.shape)

    return at
