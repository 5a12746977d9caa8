"""The instrument's geometry and its air against closed forms."""

from math import atan2, cos, degrees, hypot, pi, radians, sin

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sims.geocom import _optics
from sims.geocom._optics import AxisErrors, Direction

angles = st.floats(0.0, 2 * pi, exclude_max=True)
zeniths = st.floats(radians(20), radians(160))
lengths = st.floats(500.0, 20_000.0)
ARCSEC = pi / 648_000


def test_hz_grows_clockwise_from_north_and_v_from_the_zenith():
    north, east, up = (_optics.direction_of(place) for place in [(0, 1000, 0), (1000, 0, 0), (0, 1e-9, 1000)])
    assert (north.hz, north.v) == pytest.approx((0.0, pi / 2))
    assert (east.hz, east.v) == pytest.approx((pi / 2, pi / 2))
    assert up.v == pytest.approx(0.0)


@given(angles, zeniths, lengths)
def test_a_point_has_the_same_place_from_both_faces(hz, v, length):
    place = _optics.point_at(hz, v, length)
    for face in (1, 2):
        towards = _optics.direction_of(place, face)
        assert towards.face == face
        assert _optics.point_at(towards.hz, towards.v, length) == pytest.approx(place, abs=1e-6)


@given(angles, zeniths)
def test_the_mean_of_two_faces_has_neither_collimation_nor_index_error(hz, v):
    errors = AxisErrors(collimation=20 * ARCSEC, index=-30 * ARCSEC)
    one = errors.reading(Direction(hz, v))
    two = errors.reading(Direction(hz, v).other_face())
    mean_hz = one.hz + _optics.difference(two.hz - pi, one.hz) / 2
    assert _optics.difference(mean_hz, hz) == pytest.approx(0.0, abs=1e-12)
    assert (one.v + 2 * pi - two.v) / 2 == pytest.approx(v, abs=1e-12)
    assert _optics.difference(one.hz, two.hz - pi) / 2 == pytest.approx(20 * ARCSEC / sin(v), abs=1e-12)
    assert (one.v + two.v - 2 * pi) / 2 == pytest.approx(-30 * ARCSEC, abs=1e-12)


@given(angles, st.one_of(zeniths, zeniths.map(lambda v: 2 * pi - v)))
def test_a_reading_gives_back_its_direction(hz, v):
    errors = AxisErrors(collimation=60 * ARCSEC, index=45 * ARCSEC)
    back = errors.direction(errors.reading(Direction(hz, v)))
    assert _optics.difference(back.hz, hz) == pytest.approx(0.0, abs=1e-12)
    assert back.v == pytest.approx(v, abs=1e-12)


@given(st.floats(-0.05, 0.05), st.floats(-0.05, 0.05), st.tuples(*[st.floats(-9e3, 9e3)] * 3))
def test_levelling_takes_up_to_the_z_axis_and_keeps_lengths_and_heading(x, y, place):
    length = np.sqrt(1 + x * x + y * y)
    up = (x / length, y / length, 1 / length)
    tilt = _optics.tilt_of(np.eye(4).tolist(), up)
    assert degrees(hypot(*tilt)) == pytest.approx(degrees(atan2(hypot(x, y), 1.0)), abs=1e-9)
    assert _optics.levelled(tilt, up) == pytest.approx((0.0, 0.0, 1.0), abs=1e-9)
    assert np.linalg.norm(_optics.levelled(tilt, place)) == pytest.approx(np.linalg.norm(place), abs=1e-6)


def test_the_tilt_is_seen_in_the_instruments_own_axes():
    quarter = [[0.0, -1.0, 0.0, 5.0], [1.0, 0.0, 0.0, 6.0], [0.0, 0.0, 1.0, 7.0], [0.0, 0.0, 0.0, 1.0]]
    up = (0.0, sin(0.01), cos(0.01))  # along the instrument's x, turned by 90° about z
    assert _optics.tilt_of(quarter, up) == pytest.approx((0.0, -0.01))


def test_a_point_of_the_base_frame_is_seen_from_where_the_instrument_is():
    quarter = [[0.0, -1.0, 0.0, 100.0], [1.0, 0.0, 0.0, 200.0], [0.0, 0.0, 1.0, 300.0], [0.0, 0.0, 0.0, 1.0]]
    assert _optics.to_instrument(quarter, (100.0, 205.0, 300.0)) == pytest.approx((5.0, 0.0, 0.0))


def test_standard_air_needs_no_correction_and_a_degree_needs_one_ppm():
    vapour = _optics.vapour_of_humidity(12.0, 60.0)
    standard = _optics.ppm_of_air(12.0, 1013.25, vapour)
    assert standard == pytest.approx(0.1, abs=0.01)  # its coefficients are rounded
    assert _optics.ppm_of_air(13.0, 1013.25, vapour) - standard == pytest.approx(1.0, abs=0.02)
    assert _optics.ppm_of_air(12.0, 1023.25, vapour) - standard == pytest.approx(-2.83, abs=0.01)


def test_a_wet_bulb_thermometer_gives_the_vapour_of_the_humidity():
    # Sprung's psychrometer table: 20 °C dry, 15 °C wet at 1013 hPa is about 59 % humidity
    vapour = _optics.vapour_of_wet_bulb(20.0, 15.0, 1013.25)
    assert vapour / _optics.saturation_hpa(20.0) == pytest.approx(0.587, abs=0.01)


def test_a_distance_is_right_where_air_and_constant_are_set_as_they_are():
    right = {"ppm_set": 8.0, "ppm_true": 8.0, "constant_set_mm": -3.8, "constant_true_mm": -3.8}
    assert _optics.measured_mm(4000.0, **right) == pytest.approx(4000.0, abs=1e-12)
    assert _optics.measured_mm(4000.0, **{**right, "ppm_set": 18.0}) == pytest.approx(4000.04, abs=1e-3)
    assert _optics.measured_mm(4000.0, **{**right, "constant_set_mm": 0.0}) == pytest.approx(4003.8, abs=1e-12)
