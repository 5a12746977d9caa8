"""Moments of contact on a straight way past a sphere, where they are known in closed form."""

from __future__ import annotations

from math import sqrt

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sims.scene.motions import crossings

MS = 1_000_000
RADIUS = 30.0


def line_past_a_sphere(start_mm, offset_mm, speed_mm_s):
    """Gap to a sphere of 30 mm at the origin for a tip on the line y = offset, from x = start at constant speed."""
    return lambda t: sqrt((start_mm + speed_mm_s * t * 1e-9) ** 2 + offset_mm**2) - RADIUS


@given(st.floats(0.01, 3.99), st.floats(0.0, 29.0))
def test_contact_on_a_line_at_constant_speed_is_found_to_the_nanosecond(contact_ms, offset):
    speed = 5.0
    start = -sqrt(RADIUS**2 - offset**2) - speed * contact_ms * 1e-3
    (found,) = crossings(line_past_a_sphere(start, offset, speed), (0, 2 * MS, 4 * MS))
    assert found[1] is True
    assert found[0] == pytest.approx(
        contact_ms * MS, abs=20
    )  # a float of 30 mm resolves 4e-15 mm: 1 ns at 5 mm/s is 5e-9


def test_a_passage_between_two_looks_is_seen_as_contact_and_release():
    half_chord = sqrt(RADIUS**2 - 29.9**2)
    gap = line_past_a_sphere(-4.0, 29.9, 1000.0)
    (contact, closed), (release, closed_after) = crossings(gap, (0, 5 * MS, 10 * MS))
    assert (closed, closed_after) == (True, False)
    assert contact == pytest.approx((4.0 - half_chord) * MS, abs=2)
    assert release == pytest.approx((4.0 + half_chord) * MS, abs=2)


def test_a_passage_at_a_hair_is_no_contact():
    assert crossings(line_past_a_sphere(-4.0, 30.001, 1000.0), (0, 5 * MS, 10 * MS)) == []


def test_the_found_moment_is_the_first_at_which_the_gap_is_closed():
    gap = line_past_a_sphere(-31.0, 0.0, 500.0)
    ((moment, _),) = crossings(gap, (0, 2 * MS, 4 * MS))
    assert gap(moment) <= 0.0 < gap(moment - 1)


def test_staying_inside_or_outside_is_no_change():
    assert crossings(lambda t: 1.0, (0, 1, 2)) == []
    assert crossings(lambda t: -1.0, (0, 1, 2)) == []
