"""Two-face limits with their reasons; gravity in the base with the σ that repeats show."""

from __future__ import annotations

import numpy as np
import pytest

from cellctl.kinematics import pose_from_xyz_abc
from cellctl.metrology.instrument_checks import TwoFaceLimits, two_face_check
from cellctl.metrology.measured_pose import MeasuredPose, gravity_in_base, moved_by, nees_range

LIMITS = TwoFaceLimits(error_mm=0.1, change_mm=0.03)


def test_errors_below_the_limit_pass_with_their_worst_point():
    found = two_face_check([[0.01, 0.02], [0.06, -0.05], [0.0, 0.01]], LIMITS)
    assert found.passed
    assert found.worst == 1
    assert found.worst_mm == pytest.approx(np.hypot(0.06, 0.05))


def test_an_error_above_the_limit_names_the_point_and_the_cure():
    found = two_face_check([[0.01, 0.02], [0.09, 0.09]], LIMITS)
    assert not found.passed
    assert "point 2" in found.reason
    assert "adjust" in found.reason


def test_a_change_since_the_start_does_not_pass_although_each_error_does():
    found = two_face_check([[0.05, 0.0]], LIMITS, before_mm=[[0.0, 0.0]])
    assert not found.passed
    assert "changed by 0.050" in found.reason


def test_missing_values_are_refused():
    with pytest.raises(ValueError, match="measure them again"):
        two_face_check([[np.nan, 0.0]], LIMITS)


def test_gravity_of_a_tilted_base_is_found_with_the_sigma_that_repeats_show():
    rng = np.random.default_rng(1)
    level = 5e-5
    spread = np.diag([0.1, 0.1, 0.1, 3e-5, 8e-5, 1e-4]) ** 2
    true = pose_from_xyz_abc([2500.0, 0.0, 800.0], [120.0, 0.4, -0.6])  # the base is tilted by 0.7° to gravity
    values = []
    for _ in range(300):
        seen = moved_by(true, rng.multivariate_normal(np.zeros(6), spread))
        tilted = moved_by(np.eye(4), np.append([0.0] * 3, np.append(level * rng.normal(size=2), 0.0)))
        found = gravity_in_base(MeasuredPose(seen, spread), level)
        error = found.direction - true[:3, :3] @ tilted[:3, :3] @ [0.0, 0.0, -1.0]
        values.append(error @ np.linalg.pinv(found.covariance, rcond=1e-6, hermitian=True) @ error / 2.0)
    assert nees_range(values, 2).consistent
    assert np.degrees(found.tilt_rad) == pytest.approx(np.hypot(0.4, 0.6), abs=0.02)
    assert 5e-5 < found.sigma_tilt_rad < 2e-4


def test_an_upright_station_gives_gravity_straight_down():
    found = gravity_in_base(MeasuredPose(np.eye(4), np.eye(6) * 1e-10), 1e-5)
    assert np.array_equal(found.direction, [0.0, 0.0, -1.0])
    assert found.tilt_rad == 0.0
    assert found.sigma_tilt_rad == pytest.approx(np.sqrt(2.0) * 1e-5)
