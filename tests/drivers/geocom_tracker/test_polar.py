"""A point's place and covariance from range and angles, against Monte Carlo and closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellctl.devices import Weather
from drivers.geocom_tracker.instrument import wet_bulb_c
from drivers.geocom_tracker.polar_points import (
    PROFILES,
    Polar,
    covariances,
    first_face,
    mean_of,
    scatter_of,
    to_polar,
    to_xyz,
)

TDRA = PROFILES["tdra6000"]
LENGTHS = st.floats(-9000, 9000)
PLACES = st.tuples(LENGTHS, LENGTHS, LENGTHS).filter(lambda p: math.hypot(p[0], p[1]) > 10)
NO_SCATTER = (0.0, 0.0, 0.0)


def test_the_frame_is_right_handed_hz_clockwise_v_from_the_zenith():
    assert to_xyz(Polar(0.0, math.pi / 2, 1000)) == pytest.approx((0, 1000, 0), abs=1e-9)
    assert to_xyz(Polar(math.pi / 2, math.pi / 2, 1000)) == pytest.approx((1000, 0, 0), abs=1e-9)
    assert to_xyz(Polar(1.0, 0.0, 1000)) == pytest.approx((0, 0, 1000), abs=1e-9)


@given(PLACES)
def test_place_and_direction_are_inverse(place):
    assert to_xyz(to_polar(place)) == pytest.approx(place, abs=1e-6)


@given(PLACES)
def test_the_second_face_reads_the_same_place(place):
    one = to_polar(place)
    two = Polar((one.hz + math.pi) % math.tau, math.tau - one.v, one.range_mm)
    assert to_xyz(two) == pytest.approx(place, abs=1e-6)
    assert to_xyz(first_face(two)) == pytest.approx(place, abs=1e-6)


def test_a_place_without_direction_is_an_error():
    with pytest.raises(ValueError, match="no direction"):
        to_polar((0.0, 0.0, 0.0))


def test_readings_around_north_are_averaged_to_north():
    mean = mean_of([Polar(math.tau - 1e-4, 1.5, 1000), Polar(1e-4, 1.5, 1000)])
    assert min(mean.hz, math.tau - mean.hz) < 1e-12


@pytest.mark.parametrize("name", PROFILES)
@pytest.mark.parametrize("place", [(1500.0, 2500.0, 300.0), (-4000.0, 1000.0, 3500.0), (200.0, -6000.0, -900.0)])
@pytest.mark.parametrize(("samples", "faces"), [(1, 1), (5, 1), (10, 2)])
def test_the_covariance_is_that_of_simulated_readings(name, place, samples, faces):
    """Draw ranges and angles with the profile's errors, compute points, compare their covariance."""
    profile, true, rng, draws = PROFILES[name], to_polar(place), np.random.default_rng(1), 40_000
    distance = true.range_mm
    one, rest, shared = profile.sample, profile.common, (draws, 1)
    along = (one.range_mm + one.range_ppm * distance / 1e6) * rng.normal(size=(draws, samples))
    along = (along + (rest.range_mm + rest.range_ppm * distance / 1e6) * rng.normal(size=shared)).mean(1)
    across = (one.across_mm + one.angle_rad * distance) * rng.normal(size=(2, draws, samples))
    across += (rest.across_mm + rest.angle_rad * distance) * rng.normal(size=(2, *shared))
    across += rng.normal(size=(2, *shared)) * (profile.one_face_rad * distance if faces == 1 else 0.0)
    across += rng.normal(size=(2, *shared)) * 0.15e-9 * distance**2  # refraction
    across = across.mean(2)
    points = np.array(
        [
            to_xyz(Polar(true.hz + h / (distance * math.sin(true.v)), true.v + v / distance, distance + r))
            for r, h, v in zip(along, *across, strict=True)
        ]
    ) + rng.normal(0, 0.02, (draws, 3))
    covariance, _ = covariances(true, profile, samples=samples, faces=faces, scatter=NO_SCATTER, centring_mm=0.02)
    whitened = np.linalg.solve(np.linalg.cholesky(np.array(covariance)), (points - points.mean(0)).T)
    assert np.cov(whitened) == pytest.approx(np.eye(3), abs=0.04)  # 5 σ of a variance of 40 000 draws


def test_more_samples_reduce_their_own_part_as_one_over_n_and_neither_pointing_nor_the_common_part():
    mean = to_polar((2000.0, 3000.0, 500.0))

    def of(samples):
        return [
            np.array(part)
            for part in covariances(mean, TDRA, samples=samples, faces=1, scatter=NO_SCATTER, centring_mm=0.01)
        ]

    (one, common), (two, _), (many, still_common) = of(1), of(2), of(10**12)
    assert still_common == pytest.approx(common)
    assert one - many == pytest.approx(2.0 * (two - many), abs=1e-9)
    assert np.all(np.linalg.eigvalsh(common) > 0)
    pointing = np.linalg.eigvalsh(many - common)
    assert pointing[0] == pytest.approx(0.0, abs=1e-9)
    assert np.all(pointing[1:] >= 0.05**2)


def test_each_aim_of_a_nest_errs_by_the_pointing_that_its_own_part_states():
    """What two visits to a nest differ by is judged by the part that no other point shares."""
    covariance, common = covariances(
        to_polar((0.0, 3000.0, 0.0)), TDRA, samples=3, faces=1, scatter=NO_SCATTER, centring_mm=0.01
    )
    assert math.sqrt(covariance[0][0] - common[0][0]) == pytest.approx(0.053, abs=0.005)


def test_two_faces_have_a_smaller_common_part_across_the_beam():
    mean = to_polar((0.0, 5000.0, 0.0))
    one, two = (
        covariances(mean, TDRA, samples=4, faces=faces, scatter=NO_SCATTER, centring_mm=0.0)[1] for faces in (1, 2)
    )
    assert two[0][0] < one[0][0]
    assert two[1][1] == pytest.approx(one[1][1])


def test_a_clearly_larger_scatter_of_the_samples_replaces_the_profiles():
    mean = to_polar((0.0, 5000.0, 0.0))
    shaken, common = covariances(mean, TDRA, samples=4, faces=1, scatter=(1.0, 0.0, 0.0), centring_mm=0.0)
    assert shaken[1][1] - common[1][1] == pytest.approx(1.0 / 4)


def test_the_scatter_is_the_standard_deviation_about_each_faces_mean():
    assert scatter_of([(1.0, 0, 0), (-1.0, 0, 0), (2.0, 0, 0), (-2.0, 0, 0)], 2)[0] == pytest.approx(math.sqrt(10 / 2))
    assert scatter_of([(0.0, 0.0, 0.0)], 1) == NO_SCATTER


@given(st.floats(10, 35), st.floats(20, 90))
def test_the_wet_bulb_temperature_agrees_with_stulls_empirical_formula(dry, humidity):
    """Stull, J. Appl. Meteor. Climatol. 50 (2011) 2267: at 1013 hPa within −1.0 … +0.65 K of the psychrometer."""
    stull = (
        dry * math.atan(0.151977 * math.sqrt(humidity + 8.313659))
        + math.atan(dry + humidity)
        - math.atan(humidity - 1.676331)
        + 0.00391838 * humidity**1.5 * math.atan(0.023101 * humidity)
        - 4.686035
    )
    assert -1.0 <= stull - wet_bulb_c(Weather(dry, 1013.25, humidity)) <= 0.65


def test_the_wet_bulb_temperature_of_saturated_air_is_its_temperature():
    assert wet_bulb_c(Weather(20.0, 1013.25, 100.0)) == pytest.approx(20.0, abs=1e-6)
