"""The following of an axis against the differential equation it is said to obey."""

from __future__ import annotations

import itertools

import pytest

from sims.krc._servo import Servo
from sims.scene.motions import State

H = 0.004
OMEGA = 1 / 0.012


def run(servo, set_points, start=0.0):
    state, before, places = State((start,), (0.0,)), (start,), []
    for point in set_points:
        state, before = servo.follow(state, before, (point,)), (point,)
        places.append((state.joints[0], state.velocity[0]))
    return places


def integrated(set_points, steps=400):
    """ẍ = ω²(u − x) − 2ωẋ by small explicit steps, u linear within each cycle."""
    x = v = u0 = 0.0
    places = []
    for u1 in set_points:
        for k in range(steps):
            u = u0 + (u1 - u0) * (k + 0.5) / steps
            a = OMEGA**2 * (u - x) - 2 * OMEGA * v
            x, v = x + v * H / steps + a * (H / steps) ** 2 / 2, v + a * H / steps
        u0 = u1
        places.append((x, v))
    return places


def test_an_axis_follows_as_its_differential_equation_says():
    points = [0.004 * i for i in range(1, 20)] + [0.076] * 20
    for found, expected in zip(run(Servo([154.0], H, 1.0), points), integrated(points), strict=True):
        assert found == pytest.approx(expected, abs=2e-4)


def test_at_constant_speed_the_axis_is_24_ms_behind():
    (x, v) = run(Servo([154.0], H, 1.0), [0.005 * i for i in range(1, 100)])[-1]
    assert v == pytest.approx(0.005 / H)
    assert 0.005 * 99 - x == pytest.approx(0.024 * v)


def test_a_set_point_that_stands_still_lets_the_axis_run_on_and_come_to_rest_without_overshoot():
    places = run(Servo([154.0], H, 1.0), [0.005 * i for i in range(1, 100)] + [0.495] * 60)
    at_stop = places[98][0]
    assert at_stop < 0.495 - 0.02
    assert all(x <= 0.495 + 1e-12 for x, _ in places)
    assert places[-1] == (pytest.approx(0.495, abs=1e-6), pytest.approx(0.0, abs=1e-4))


def test_a_jump_is_bounded_by_the_drives_acceleration_and_still_ends_there():
    places = run(Servo([154.0], H, 1.0), [5.0] * 400)
    velocities = [0.0] + [v for _, v in places]
    assert max(abs(b - a) for a, b in itertools.pairwise(velocities)) <= 154.0 / 0.4 * H * (1 + 1e-9)
    assert places[-1][0] == pytest.approx(5.0, abs=1e-3)


def test_switched_off_the_axis_is_where_it_is_commanded_to_be():
    assert [x for x, _ in run(Servo([154.0], H, 0.0), [1.0, 2.0, 1.5])] == [1.0, 2.0, 1.5]
