"""A pose from three nests on a plate: its covariance, and mistakes that the distances between the nests show."""

from __future__ import annotations

import numpy as np
import pytest

from cellctl.kinematics import pose_from_xyz_abc
from cellctl.metrology.measured_points import Points, beam_directions
from cellctl.metrology.measured_pose import nees_range
from cellctl.metrology.nests import NestMeasuredTwice, NestPlate, NestsDoNotFit, NestsSwapped, frame_of, plate_pose

CORNERS = np.array([[0.0, 0.0, 0.0], [150.0, 0.0, 0.0], [30.0, 110.0, 0.0]])
PLACE = pose_from_xyz_abc([2500.0, -600.0, 300.0], [40.0, -20.0, 75.0])
NEST_XYZ = CORNERS @ PLACE[:3, :3].T + PLACE[:3, 3]


def station(xyz, rng=None, along=0.03, across=0.01, common=0.2):
    beams = beam_directions(xyz)
    shared = beams @ np.diag([common**2, 0.0, 0.0]) @ np.swapaxes(beams, 1, 2)
    whole = shared + beams @ np.diag([along**2, across**2, across**2]) @ np.swapaxes(beams, 1, 2)
    points = Points.of(xyz, whole, shared)
    if rng is None:
        return points
    seen = xyz + rng.multivariate_normal(np.zeros(xyz.size), points.joint_covariance()).reshape(-1, 3)
    return Points.of(seen, whole, shared)


def test_exact_nests_give_the_plates_pose_exactly():
    found = plate_pose(station(NEST_XYZ), NestPlate.of(CORNERS))
    assert np.allclose(found.matrix, PLACE, atol=1e-6)


@pytest.mark.parametrize("certificate", [0.0, 0.02])
def test_the_stated_covariance_is_what_repeated_measurements_show(certificate):
    rng = np.random.default_rng(1)
    values = []
    for _ in range(200):
        plate = NestPlate.of(CORNERS + certificate * rng.normal(size=(3, 3)), certificate)
        values.append(plate_pose(station(NEST_XYZ, rng), plate).nees(PLACE))
    assert nees_range(values, 6).consistent


def test_the_common_range_error_moves_the_pose_and_is_not_averaged_away():
    found = plate_pose(station(NEST_XYZ), NestPlate.of(CORNERS))
    beam = PLACE[:3, 3] / np.linalg.norm(PLACE[:3, 3])
    # averaged, 0.2 would be 0.12; the known distances between diverging beams find a little of it: 0.17
    assert np.sqrt(beam @ found.covariance[:3, :3] @ beam) > 0.15
    assert found.sigma[3:].max() < 0.05 / 50.0  # the turn has the single points' noise over the plate's size only


def test_a_plate_without_certificate_is_learnt_from_one_measurement_of_it():
    rng = np.random.default_rng(2)
    values = []
    for _ in range(200):
        plate = NestPlate.learnt([station(NEST_XYZ, rng)])
        moved = pose_from_xyz_abc([2300.0, 100.0, 500.0], [10.0, 30.0, -60.0])
        true = moved @ np.linalg.inv(PLACE) @ frame_of(NEST_XYZ)
        xyz = CORNERS @ moved[:3, :3].T + moved[:3, 3]
        values.append(plate_pose(station(xyz, rng), plate).nees(true))
    assert nees_range(values, 6).consistent


def test_a_plate_learnt_at_many_poses_is_nearly_exact_and_states_it():
    rng = np.random.default_rng(4)
    poses = [pose_from_xyz_abc([2500.0, -600.0, 300.0], rng.uniform(-80, 80, 3)) for _ in range(50)]
    measured = [station(CORNERS @ at[:3, :3].T + at[:3, 3], rng) for at in poses]
    one, many = NestPlate.learnt(measured[:1]), NestPlate.learnt(measured)
    true = (CORNERS - CORNERS[0]) @ frame_of(CORNERS)[:3, :3]
    assert np.abs(many.xyz - true).max() < 0.3 * np.sqrt(np.trace(one.covariance) / 9.0)
    assert np.trace(many.covariance) == pytest.approx(np.trace(one.covariance) / 50.0, rel=0.1)
    error = many.xyz[1, 0] - true[1, 0]
    assert abs(error) < 3.0 * np.sqrt(many.covariance[0, 0] + many.covariance[3, 3])


def test_a_nest_measured_twice_is_named():
    twice = station(NEST_XYZ[[0, 1, 1]], np.random.default_rng(3))
    with pytest.raises(NestMeasuredTwice, match=r"nests P2 and P3 .* measured twice"):
        plate_pose(twice, NestPlate.of(CORNERS), ("P1", "P2", "P3"))


def test_swapped_nests_are_named_in_the_order_that_fits():
    swapped = station(NEST_XYZ[[0, 2, 1]], np.random.default_rng(3))
    with pytest.raises(NestsSwapped, match="in the order 1, 3, 2"):
        plate_pose(swapped, NestPlate.of(CORNERS))


def test_a_reflector_beside_its_nest_is_refused_with_the_distance_that_does_not_fit():
    bad = NEST_XYZ.copy()
    bad[2] += PLACE[:3, 1] * 0.8
    with pytest.raises(NestsDoNotFit, match=r"nests 1 and 3 .*\+0\.\d+ from the plate's"):
        plate_pose(station(bad), NestPlate.of(CORNERS))


def test_sound_nests_are_seldom_refused():
    rng = np.random.default_rng(4)
    for _ in range(150):
        plate_pose(station(NEST_XYZ, rng), NestPlate.of(CORNERS))


def test_a_missing_measurement_is_refused():
    with pytest.raises(NestsDoNotFit, match="2 measurements of 3 nests"):
        plate_pose(station(NEST_XYZ[:2]), NestPlate.of(CORNERS))
