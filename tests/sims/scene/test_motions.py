"""Motions of the axes: limits kept, ends met, velocities that are the derivative of the places."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from sims.scene.motions import Braking, Cycle, PointToPoint, State

SPEEDS = (154.0, 154.0, 228.0)
ACCELERATIONS = tuple(speed / 0.4 for speed in SPEEDS)
START = (0.0, -90.0, 90.0)
ANGLES = st.tuples(*[st.floats(-150, 150)] * 3)
T0 = 123_456_789


def samples(motion, count=4001):
    times = np.linspace(motion.start_ns, motion.end_ns, count).astype(np.int64)
    return (
        times * 1e-9,
        np.array([motion.at(int(t)) for t in times]),
        np.array([motion.velocity(int(t)) for t in times]),
    )


@pytest.mark.long
@given(ANGLES, st.floats(1, 100))
def test_a_point_to_point_motion_keeps_speed_and_acceleration_of_every_axis(target, percent):
    assume(max(abs(a - b) for a, b in zip(START, target, strict=True)) > 0.1)
    speeds = [speed * percent / 100 for speed in SPEEDS]
    motion = PointToPoint(START, target, speeds, ACCELERATIONS, T0)
    assert motion.at(motion.start_ns) == pytest.approx(START)
    assert motion.at(motion.end_ns) == pytest.approx(target)
    t, _, v = samples(motion)
    assert (np.abs(v) <= np.array(speeds) * (1 + 1e-9)).all()
    acceleration = np.abs(np.diff(v, axis=0) / np.diff(t)[:, None])
    assert (acceleration <= np.array(ACCELERATIONS) * 1.001).all()


def test_the_leading_axis_uses_its_speed_and_its_acceleration_to_the_full():
    motion = PointToPoint(START, (150.0, -90.0, 100.0), SPEEDS, ACCELERATIONS, T0)
    t, _, v = samples(motion)
    assert v[:, 0].max() == pytest.approx(154.0)
    assert np.max(np.diff(v[:, 0]) / np.diff(t)) == pytest.approx(154.0 / 0.4, rel=1e-3)


@given(ANGLES)
def test_velocity_is_the_derivative_of_the_place_in_every_motion(target):
    assume(max(abs(a - b) for a, b in zip(START, target, strict=True)) > 0.1 and max(map(abs, target)) > 1.0)
    for motion in (
        PointToPoint(START, target, SPEEDS, ACCELERATIONS, T0),
        Braking(START, target, ACCELERATIONS, T0),
        Cycle(State(START, target), State((0.1, -90.1, 90.2), (1.0, 2.0, 3.0)), T0, T0 + 4_000_000),
    ):
        t, q, v = samples(motion, 401)
        step = np.diff(t)[:, None]
        scale = np.abs(v).max() + 1e-9
        assert np.abs(np.diff(q, axis=0) / step - (v[1:] + v[:-1]) / 2).max() < 0.02 * scale


def test_braking_takes_the_way_that_speed_and_deceleration_say():
    motion = Braking(START, (10.0, -5.0, 0.0), ACCELERATIONS, T0)
    seconds = 10.0 / ACCELERATIONS[0]
    assert motion.end_ns - T0 == pytest.approx(seconds * 1e9, abs=1)
    assert np.subtract(motion.at(motion.end_ns), START) == pytest.approx([5 * seconds, -2.5 * seconds, 0.0])
    assert motion.velocity(motion.end_ns) == pytest.approx((0, 0, 0))


def test_braking_from_standstill_and_moving_nowhere_are_over_at_once():
    assert Braking(START, (0.0,) * 3, ACCELERATIONS, T0).end_ns == T0
    nowhere = PointToPoint(START, START, SPEEDS, ACCELERATIONS, T0)
    assert nowhere.end_ns == T0
    assert nowhere.at(T0) == START
