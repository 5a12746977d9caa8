"""Nests measured again: a station at rest, bumped once, drifting; a robot that grew; a loose nest; a wrong constant."""

from __future__ import annotations

import numpy as np
import pytest

from cellctl.kinematics import pose_from_xyz_abc
from cellctl.metrology.instrument_checks import InsensitiveDistances, KnownDistance, constant_error
from cellctl.metrology.measured_points import Points, beam_directions
from cellctl.metrology.measured_pose import nees_range
from cellctl.metrology.monuments import NestLoose, StationState, robot_growth, station_motion

NESTS = np.array(
    [[3500.0, 1200.0, -800.0], [1800.0, -2200.0, -850.0], [-1500.0, 900.0, -820.0], [2600.0, 100.0, 900.0]]
)
BUMP = pose_from_xyz_abc([0.4, -0.3, 0.1], [0.008, 0.0, 0.004])
HOURS = 3600.0 * np.arange(6)


def covariances(xyz, along=0.03, across=0.015, common=0.2):
    beams = beam_directions(xyz)
    shared = beams @ np.diag([common**2, 0.0, 0.0]) @ np.swapaxes(beams, 1, 2)
    return shared + beams @ np.diag([along**2, across**2, across**2]) @ np.swapaxes(beams, 1, 2), shared


def check(rng, moved=None, nests=NESTS, range_zero=0.15):
    """Nests seen from a station that moved by `moved`, with a range zero that is the same in every check."""
    there = np.eye(4) if moved is None else moved
    xyz = nests @ there[:3, :3].T + there[:3, 3]
    whole, shared = covariances(xyz)
    alone = np.linalg.cholesky(whole - shared)
    seen = xyz + (alone @ rng.normal(size=(len(xyz), 3, 1)))[..., 0] + range_zero * beam_directions(xyz)[..., 0]
    return Points.of(seen, whole, shared)


def drifting(rate, hours):
    return pose_from_xyz_abc(np.array([1.0, 0.5, 0.0]) * rate * hours, [0.0, 0.0, 0.0])


def test_a_station_at_rest_is_still_and_hardly_ever_said_to_move():
    rng = np.random.default_rng(1)
    verdicts = [station_motion([check(rng) for _ in range(6)], HOURS).verdict for _ in range(120)]
    assert verdicts.count(StationState.STILL) >= 119


def test_a_bumped_station_moved_once_between_the_right_checks_by_the_right_amount():
    rng = np.random.default_rng(2)
    values = []
    for _ in range(60):
        found = station_motion([check(rng, BUMP if k >= 4 else None) for k in range(6)], HOURS)
        assert found.verdict is StationState.MOVED
        assert found.before == 4
        assert found.confirmed
        values.append(found.motion.nees(BUMP))
    low, high = nees_range(values, 6)[1:]
    assert low < np.mean(values) < 1.1 * high  # the range zero turns a little with the bump: not in the covariance


def test_a_motion_seen_by_the_last_check_alone_is_not_confirmed():
    rng = np.random.default_rng(3)
    found = station_motion([check(rng), check(rng), check(rng, BUMP)], HOURS[:3])
    assert found.verdict is StationState.MOVED
    assert not found.confirmed


def test_a_drifting_station_is_moving_not_moved_and_its_rate_is_found():
    rng = np.random.default_rng(4)
    found = station_motion([check(rng, drifting(0.1, k)) for k in range(6)], HOURS)
    assert found.verdict is StationState.MOVING
    assert found.rate_mm_h == pytest.approx(0.1 * np.hypot(1.0, 0.5), rel=0.15)


def test_a_significant_motion_within_the_tolerance_is_still():
    rng = np.random.default_rng(4)
    checks = [check(rng, drifting(0.03, k)) for k in range(6)]
    assert station_motion(checks, HOURS).verdict is not StationState.STILL
    assert station_motion(checks, HOURS, tolerance_mm=0.4).verdict is StationState.STILL


def test_a_robot_that_grew_moves_no_nest():
    rng = np.random.default_rng(5)
    robot = np.array([[2200.0, 300.0, 200.0]])
    grown = robot + np.array([0.1, 0.0, 0.25])
    assert station_motion([check(rng), check(rng)], HOURS[:2]).verdict is StationState.STILL
    found = robot_growth(check(rng, nests=robot), check(rng, nests=grown))
    assert found.grew
    assert np.linalg.norm(found.displacement[0] - [0.1, 0.0, 0.25]) < 0.2
    assert not robot_growth(check(rng, nests=robot), check(rng, nests=robot)).grew


def test_growth_is_told_from_a_motion_of_the_station_in_between():
    rng = np.random.default_rng(6)
    robot = np.array([[2200.0, 300.0, 200.0]])
    values, grew = [], 0
    for _ in range(80):
        motion = station_motion([check(rng), check(rng), check(rng, BUMP), check(rng, BUMP)], HOURS[:4]).motion
        found = robot_growth(check(rng, nests=robot), check(rng, BUMP, nests=robot), motion)
        grew += found.grew
        flat = found.displacement.ravel()
        values.append(flat @ np.linalg.solve(found.covariance, flat) / 3.0)
    assert grew <= 1
    assert nees_range(values, 3).consistent


def test_a_loose_nest_is_named_instead_of_a_motion():
    rng = np.random.default_rng(7)
    shifted = NESTS + np.array([[0.0] * 3, [0.0] * 3, [0.8, 0.3, 0.0], [0.0] * 3])
    with pytest.raises(NestLoose, match="check 3 nest N3"):
        station_motion([check(rng), check(rng), check(rng, nests=shifted)], HOURS[:3], names=("N1", "N2", "N3", "N4"))


def test_a_station_set_up_at_another_place_is_a_motion_too():
    rng = np.random.default_rng(8)
    far = pose_from_xyz_abc([300.0, -900.0, 40.0], [65.0, 0.3, -0.2])
    found = station_motion([check(rng, range_zero=0.0), check(rng, far, range_zero=0.0)], HOURS[:2])
    assert found.verdict is StationState.MOVED
    assert np.allclose(found.motion.matrix[:3, 3], far[:3, 3], atol=0.3)


@pytest.mark.parametrize("constant", [0.0, 1.0, -17.5])
def test_a_wrong_constant_is_found_by_a_certified_distance_with_the_station_between(constant):
    rng = np.random.default_rng(9)
    known = KnownDistance(0, 2, float(np.linalg.norm(NESTS[0] - NESTS[2])), 0.02)
    values = []
    for _ in range(150):
        found = constant_error(check(rng, range_zero=constant), [known])
        values.append(((found.error_mm - constant) / found.sigma_mm) ** 2)
    assert found.wrong is (constant != 0.0)
    assert found.sigma_mm < 0.05
    assert nees_range(values, 1, 0.999).consistent


def test_an_error_as_small_as_the_zero_of_the_instruments_range_is_measured_but_is_no_wrong_reflector():
    rng = np.random.default_rng(10)
    known = KnownDistance(0, 2, float(np.linalg.norm(NESTS[0] - NESTS[2])), 0.02)
    found = constant_error(check(rng, range_zero=0.3), [known])
    assert found.error_mm == pytest.approx(0.3, abs=4.0 * found.sigma_mm)
    assert found.error_mm > 4.0 * found.sigma_mm
    assert found.zero_sigma_mm == pytest.approx(0.2)
    assert not found.wrong


def test_nests_in_line_on_one_side_say_nothing_of_the_constant_and_are_refused():
    line = np.array([[2000.0, 0.0, 0.0], [4000.0, 10.0, 0.0]])
    with pytest.raises(InsensitiveDistances, match="station between"):
        constant_error(Points.of(line, 0.05), [KnownDistance(0, 1, 2000.0, 0.02)])
