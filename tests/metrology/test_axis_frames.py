"""Frames {B} and {T} by turning A1, A2, A5, A6 (KRG 2.3): right for the nominal robot, with σ that repeats show."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cellctl.formats import RobotFile
from cellctl.kinematics import inverse_pose, pose_from_xyz_abc
from cellctl.metrology.axis_frames import (
    Line,
    ParallelAxes,
    Turn,
    axes_of,
    axis_frames,
    base_frame,
    reflector_on_flange,
    station,
)
from cellctl.metrology.measured_points import Points, beam_directions
from cellctl.metrology.measured_pose import nees, nees_range

KR5 = RobotFile.load(Path(__file__).parents[2] / "procedures/robots/kr5_r1400.yaml").chain()
START = np.radians([10.0, -80.0, 95.0, 20.0, 60.0, -30.0])
STATION = pose_from_xyz_abc([2600.0, -500.0, 900.0], [170.0, 0.2, -0.3])
ON_FLANGE = np.array([60.0, -40.0, 150.0])


def reflector_at(chain, q):
    flange = chain.forward_flange(q)
    place = flange[..., :3, :3] @ ON_FLANGE + flange[..., :3, 3]
    there = inverse_pose(STATION)
    return np.atleast_2d(place @ there[:3, :3].T + there[:3, 3])


def postures(joint, half=40.0, count=11):
    q = np.tile(START, (count, 1))
    q[:, joint] += np.radians(np.linspace(-half, half, count))
    return q


def measured(rng, chain, common=0.0, noise=1.0):
    """Turns of A1, A2, A5, A6 and the reflector at the start; a station's noise with a common range error."""
    paths = [postures(joint) for joint in (0, 1, 4, 5)]
    xyz = np.concatenate([*(reflector_at(chain, q) for q in paths), reflector_at(chain, START)])
    beams = beam_directions(xyz)
    shared = beams @ np.diag([(noise * common) ** 2, 0.0, 0.0]) @ np.swapaxes(beams, 1, 2)
    whole = shared + beams @ np.diag((noise * np.array([0.05, 0.01, 0.01])) ** 2) @ np.swapaxes(beams, 1, 2)
    points = Points.of(xyz, whole, shared)
    seen = xyz + rng.multivariate_normal(np.zeros(xyz.size), points.joint_covariance()).reshape(-1, 3)
    points = Points.of(seen, whole, shared)
    turns = [
        Turn(points.pick(slice(11 * place, 11 * place + 11)), q[:, joint])
        for place, (joint, q) in enumerate(zip((0, 1, 4, 5), paths, strict=True))
    ]
    return axis_frames(*turns, points.pick([-1]))


def test_without_noise_the_station_and_the_reflector_on_the_flange_come_out_exactly():
    frames = measured(np.random.default_rng(0), KR5, noise=1e-4)
    assert np.allclose(station(frames, KR5, START).matrix, STATION, atol=1e-3)
    assert np.allclose(reflector_on_flange(frames, KR5, START)[0], ON_FLANGE, atol=1e-3)


def test_the_tool_frame_has_its_x_on_a6_and_its_origin_at_the_reflector():
    frames = measured(np.random.default_rng(0), KR5, noise=1e-4)
    a6 = axes_of(KR5, START)[5]
    tool = STATION @ frames.tool.matrix
    assert np.allclose(tool[:3, 0], a6.direction, atol=1e-6)
    assert tool[:3, 2] @ axes_of(KR5, START)[4].direction == pytest.approx(0.0, abs=1e-6)
    assert np.allclose(frames.tool.matrix[:3, 3], reflector_at(KR5, START)[0], atol=1e-3)


@pytest.mark.long
@pytest.mark.parametrize("common", [0.0, 0.2])
def test_with_effects_off_nees_of_station_tool_frame_and_reflector_is_about_1(common):
    rng = np.random.default_rng(5)
    exact = measured(np.random.default_rng(0), KR5, noise=1e-4)
    of_station, of_tool, of_reflector = [], [], []
    for _ in range(50):
        frames = measured(rng, KR5, common)
        of_station.append(station(frames, KR5, START).nees(STATION))
        of_tool.append(frames.tool.nees(exact.tool.matrix))
        place, covariance = reflector_on_flange(frames, KR5, START)
        of_reflector.append(nees(place - ON_FLANGE, covariance))
    assert nees_range(of_station, 6).consistent
    assert nees_range(of_tool, 6).consistent
    assert nees_range(of_reflector, 3).consistent


def test_an_error_of_the_nominal_robot_appears_as_bias_only_where_the_frame_uses_it():
    """{B} uses A1 and the common perpendicular to A2: alpha1 and a1 leave it alone, d1 moves the station by itself."""
    rng = np.random.default_rng(6)
    unused = station(measured(rng, KR5.with_parameters({"alpha1": 1e-3, "a1": 1.0})), KR5, START)
    used = station(measured(rng, KR5.with_parameters({"d1": 1.0})), KR5, START)
    assert unused.nees(STATION) < 4.0
    assert used.nees(STATION) > 20.0
    assert used.matrix[2, 3] - STATION[2, 3] == pytest.approx(-1.0, abs=5.0 * used.sigma[2])


@pytest.mark.parametrize("apart_mm", [-3.0, 0.0, 3.0])
def test_axes_that_meet_by_design_give_the_same_frame_to_whichever_side_they_miss(apart_mm):
    up = Line(np.zeros(3), np.array([0.0, 0.0, 1.0]))
    across = Line(np.array([0.0, 0.0, 180.0]), np.array([0.0, -1.0, 0.0]))
    missed = Line(np.array([apart_mm, 0.0, 180.0]), across.direction)
    assert np.allclose(base_frame(up, missed), base_frame(up, across), atol=1e-9)


def test_parallel_axes_are_refused():
    frames = axes_of(KR5, START)
    with pytest.raises(ParallelAxes, match="A1 and A2"):
        base_frame(frames[1], frames[2])
