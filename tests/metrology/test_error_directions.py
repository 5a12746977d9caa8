"""Errors by direction in the robot's base frame, and their change of scale."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cellctl.metrology.error_figures import error_directions

PLACES = np.random.default_rng(1).uniform([500, -800, 100], [1400, 800, 1200], (60, 3))
MOVED = np.tile(np.eye(3), (60, 1, 1))
"""The places follow a shift of the frame alone."""


def test_a_model_that_is_too_short_shows_its_scale() -> None:
    errors = 4e-4 * (PLACES - PLACES.mean(axis=0)) + np.random.default_rng(2).normal(0.0, 0.02, PLACES.shape)
    found = error_directions(PLACES, errors, MOVED)
    assert found.scale_ppm == pytest.approx(400.0, abs=3 * found.scale_sigma_ppm)
    assert 1.0 < found.scale_sigma_ppm < 10.0


def test_noise_alone_shows_no_scale_and_sigma_is_what_the_scale_scatters_by() -> None:
    random = np.random.default_rng(3)
    found = [error_directions(PLACES, random.normal(0.0, 0.1, PLACES.shape), MOVED) for _ in range(200)]
    ratio = np.array([each.scale_ppm / each.scale_sigma_ppm for each in found])
    assert abs(ratio.mean()) < 0.3
    assert ratio.std() == pytest.approx(1.0, abs=0.15)


def test_a_scale_is_found_although_the_registration_has_taken_a_part_of_it_up() -> None:
    turned = Rotation.random(60, random_state=4).as_matrix() * 0.2 + (PLACES / 1000.0)[:, :, None]
    columns = np.concatenate([MOVED, turned], axis=2)
    errors = 1e-3 * PLACES
    flat = columns.reshape(180, 6)
    registered = errors.ravel() - flat @ np.linalg.lstsq(flat, errors.ravel(), rcond=None)[0]
    assert error_directions(PLACES, registered.reshape(60, 3), MOVED).scale_ppm < 700.0
    assert error_directions(PLACES, registered.reshape(60, 3), columns).scale_ppm == pytest.approx(1000.0)


def test_errors_along_the_radius_about_the_vertical_are_radial_and_across_it_tangential() -> None:
    out = PLACES * [1, 1, 0] / np.linalg.norm(PLACES[:, :2], axis=1, keepdims=True)
    radial = error_directions(PLACES, 0.3 * out, MOVED)
    assert (radial.radial, radial.tangential, radial.z) == pytest.approx((0.3, 0.0, 0.0))
    across = error_directions(PLACES, 0.2 * np.cross([0, 0, 1], out), MOVED)
    assert (across.radial, across.tangential, across.z) == pytest.approx((0.0, 0.2, 0.0))
    upwards = error_directions(PLACES, np.tile([0.0, 0.0, -0.1], (60, 1)), MOVED)
    assert (upwards.x, upwards.y, upwards.z) == pytest.approx((0.0, 0.0, 0.1))
