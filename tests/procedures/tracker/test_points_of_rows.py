"""Recorded points as arrays: the pointing of the target recognition, new at each aim, belongs to each point alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cellctl.devices import MeasuredPoint
from procedures.steps.tracker.points import AIMING_MM, points_of

POINT = MeasuredPoint(
    xyz=(3000.0, 0.0, 0.0),
    covariance=((0.05, 0.0, 0.0), (0.0, 1e-4, 0.0), (0.0, 0.0, 1e-4)),
    common=((0.02, 0.0, 0.0), (0.0, 5e-5, 0.0), (0.0, 0.0, 5e-5)),
    samples=3,
    scatter=(0.1, 0.01, 0.01),
    faces=1,
    hz_rad=0.0,
    v_rad=0.0,
    range_mm=3000.0,
    time_ns=0,
    device_ms=0,
    levelled=True,
    weather=None,
    accuracy="tdra6000",
    noise_only=False,
)


def test_the_pointing_is_across_the_beam_and_not_common() -> None:
    found = points_of([POINT])
    grown = found.covariance[0] - np.array(POINT.covariance)
    assert np.diag(grown) == pytest.approx([0.0, AIMING_MM["tdra6000"] ** 2, AIMING_MM["tdra6000"] ** 2])
    assert np.array_equal(found.common[0], np.array(POINT.common))


def test_other_profiles_state_their_own_covariance() -> None:
    found = points_of([replace(POINT, accuracy="at960")])
    assert np.array_equal(found.covariance[0], np.array(POINT.covariance))
