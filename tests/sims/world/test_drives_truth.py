"""Gear waves and play, as they are seen at the tip: A1 alone turns it, so that its heading is A1's own angle."""

from __future__ import annotations

from math import atan2, degrees

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sims.cell import ERRORS
from sims.conditions import Conditions
from sims.world.drives import Backlash
from tests.helpers.sims import BENT, world

ANGLE = st.floats(-180.0, 180.0)


def turned_by(one, a1, conditions=None):
    """How far A1's link is beyond its reading, degrees, in the reading's sense (A1 counts against the model's)."""
    readings = (a1, *BENT[1:])
    x, y, _ = one.true_tcp(readings, conditions) if conditions else one.true_tcp(readings)
    u, v, _ = world().true_tcp(readings)
    return -degrees(atan2(u * y - v * x, u * x + v * y))


@pytest.mark.parametrize("seed", range(1, 8))
def test_a_joint_runs_ahead_and_behind_once_and_twice_a_turn_and_no_other_way(seed):
    one = world(seed, gear=1)
    off = np.array([turned_by(one, a1) for a1 in np.arange(36) * 10.0])
    waves = 2.0 * np.abs(np.fft.rfft(off)) / 36
    assert 0.005 <= waves[1] <= 0.01
    assert 0.0025 <= waves[2] <= 0.005
    assert max(waves[3:]) < 1e-9  # waves[0]: the other joints, which stand still


def test_phases_differ_from_joint_to_joint_and_robot_to_robot():
    phases = [wave[1] for seed in range(1, 6) for wave in world(seed, gear=1)._gear.waves]
    assert len({round(phase, 6) for phase in phases}) == 30
    assert min(phases) < -1.0
    assert max(phases) > 1.0


@pytest.mark.parametrize("seed", range(1, 8))
def test_a_link_is_half_its_play_behind_the_way_its_joint_moved_last(seed):
    one = world(seed, backlash=1)
    up, down, middle = (turned_by(one, 30.0, Conditions((d, 0, 0, 0, 0, 0))) for d in (1, -1, 0))
    assert up == pytest.approx(-down, abs=1e-9)
    assert 0.003 <= down - up <= 0.01
    assert middle == pytest.approx(0.0, abs=1e-9)
    assert turned_by(one, 30.0) == pytest.approx(0.0, abs=1e-9)


def test_each_joint_goes_by_its_own_direction():
    one = world(backlash=1)
    here = np.array(one.true_tcp(BENT))
    alone = [np.subtract(one.true_tcp(BENT, Conditions(tuple(int(i == j) for i in range(6)))), here) for j in range(6)]
    together = np.subtract(one.true_tcp(BENT, Conditions((1,) * 6)), here)
    assert together == pytest.approx(sum(alone), abs=1e-5)
    assert min(np.linalg.norm(shift) for shift in alone[:5]) > 1e-3


def test_without_play_the_direction_changes_nothing():
    assert world().true_tcp(BENT, Conditions((1,) * 6)) == world().true_tcp(BENT)


def test_a_drive_that_turns_back_takes_its_link_along_only_when_its_play_is_used_up():
    play = Backlash(1, 1, 1.0)
    (half,) = play.half_deg
    up = play.after((0.0,), (0.0,), (5.0,))
    assert up == play.behind((1,)) == (-half,)
    (back_a_little,) = play.after(up, (5.0,), (5.0 - half,))
    assert 5.0 - half + back_a_little == pytest.approx(5.0 + up[0])  # the link has not moved
    assert play.after(up, (5.0,), (4.0,)) == play.behind((-1,))


@given(st.lists(ANGLE, min_size=2, max_size=8))
def test_a_link_moves_no_farther_than_its_drive_and_never_leaves_its_play(ways):
    play = Backlash(1, 3, 1.0)
    (half,) = play.half_deg
    slack, at = (0.0,), 0.0
    for angle in ways:
        after = play.after(slack, (at,), (angle,))
        assert abs(after[0]) <= half
        assert abs((angle + after[0]) - (at + slack[0])) <= abs(angle - at) + 1e-9
        slack, at = after, angle


@given(ANGLE, ANGLE, st.floats(0.0, 1.0))
def test_a_way_in_one_direction_comes_out_the_same_in_one_piece_or_two(start, end, share):
    play = Backlash(1, 3, 1.0)
    between = start + share * (end - start)
    first = play.after((0.001,), (start,), (between,))
    assert play.after(first, (between,), (end,)) == pytest.approx(play.after((0.001,), (start,), (end,)), abs=1e-9)


@pytest.mark.parametrize("kind", ["compliance", "gear", "backlash", "expansion"])
def test_switching_one_error_on_leaves_the_draws_of_the_others_as_they_were(kind):
    part_of_compliance = "friction_torsion"
    others = {other: 1 for other in ERRORS if other not in {kind, "wear", "warm_up", part_of_compliance}}
    state = Conditions((1, -1, 1, -1, 1, -1), 35.0, 4.0)
    alone = np.subtract(world(**{kind: 1}).true_tcp(BENT, state), world().true_tcp(BENT, state))
    among = np.subtract(world(**others, **{kind: 1}).true_tcp(BENT, state), world(**others).true_tcp(BENT, state))
    assert np.linalg.norm(alone) > 0.02
    assert among == pytest.approx(alone, abs=0.02 * float(np.linalg.norm(alone)))
