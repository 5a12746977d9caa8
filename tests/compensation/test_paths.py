"""Between compensated points: lines and circles as a controller interpolates them, and the deviation from them."""

import itertools

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cellctl.calibration import Harmonics, RobotModel
from cellctl.compensation import compensate
from cellctl.compensation.paths import SINGULAR, Arc, Line, deviations, divided, posture_at
from cellctl.kinematics import SerialChain, inverse, pose, pose_from_xyz_abc
from tests.helpers.arms import KR5_LINKS

TOOL = ([59.9, 50.5, 410.3], [38.8, 3.6, 0.0])
ERRORS = {"theta2": 0.003, "theta3": -0.004, "theta5": 0.004, "d4": 0.8, "a2": -0.7, "alpha4": 0.002, "tool_y": -1.1}
HOME = np.deg2rad([0.0, -60.0, 80.0, 10.0, 60.0, 20.0])


@pytest.fixture(scope="module")
def nominal():
    return SerialChain.from_links("mdh-hayati", KR5_LINKS, None, pose_from_xyz_abc(*TOOL))


@pytest.fixture(scope="module")
def identified(nominal):
    return RobotModel(nominal.with_parameters(ERRORS))


def moved(start, xyz, turned=(0.0, 0.0, 0.0)):
    return pose(Rotation.from_rotvec(turned).as_matrix() @ start[:3, :3], start[:3, 3] + xyz)


@pytest.fixture(scope="module")
def segments(nominal):
    """Six lines and six arcs before the robot, 300 to 600 mm long, with turns of up to 40°."""
    rng = np.random.default_rng(5)
    starts = nominal.forward(HOME + rng.uniform(-0.2, 0.2, (12, 6)))
    lines = [Line(at, moved(at, (-60, 300, -120), rng.uniform(-0.4, 0.4, 3))) for at in starts[:6]]
    arcs = [
        Arc.of(at, at[:3, 3] + (-80, 150, -60), moved(at, (-40, 320, -60), rng.uniform(-0.4, 0.4, 3)))
        for at in starts[6:]
    ]
    return [*lines, *arcs]


def sent_of(nominal, identified, segment, start):
    """The segment through the compensated pseudo-targets of its ends and auxiliary point."""
    wanted = segment.poses([0.0, 0.5, 1.0])
    found = compensate(nominal, identified, wanted, np.tile(start, (3, 1)))
    assert found.converged.all()
    return segment.through(nominal.forward(found.compensated_q))


def robot_on(nominal, identified, segments, start, count):
    """Places (S, count, 3) of the identified robot's TCP at shares of segments that its controller follows."""
    poses, q = np.stack([segment.poses(np.linspace(0.0, 1.0, count)) for segment in segments], axis=1), [start]
    for goals in poses:
        q.append(inverse(nominal, goals, q[-1], tolerance_mm=1e-7).q)
    return identified.tcp(np.stack(q[1:], axis=1))


def places(segments, count):
    return np.stack([segment.poses(np.linspace(0.0, 1.0, count))[:, :3, 3] for segment in segments])


@pytest.fixture(scope="module")
def judged(nominal, identified, segments):
    start = inverse(nominal, np.stack([segment.start for segment in segments]), np.tile(HOME, (len(segments), 1))).q
    halves = [segment.piece(0.0, 1.0) for segment in segments]
    sent = [sent_of(nominal, identified, each, q) for each, q in zip(halves, start, strict=True)]
    return start, sent, deviations(nominal, identified, halves, sent, start)


def test_a_line_is_straight_and_turns_about_one_axis_in_proportion():
    start = pose_from_xyz_abc([100.0, 0.0, 0.0], [0.0, 0.0, 0.0])
    end = pose_from_xyz_abc([300.0, 0.0, 80.0], [90.0, 0.0, 0.0])
    np.testing.assert_allclose(
        Line(start, end).poses([0.25])[0], pose_from_xyz_abc([150.0, 0.0, 20.0], [22.5, 0.0, 0.0]), atol=1e-12
    )


def test_a_circle_goes_from_start_through_the_auxiliary_point_to_the_end():
    circle = lambda angle: 50.0 * np.array([np.cos(angle), np.sin(angle), 0.0]) + [10.0, 20.0, 30.0]  # noqa: E731
    arc = Arc.of(pose(np.eye(3), circle(0.0)), circle(3.5), pose(np.eye(3), circle(4.0)))
    shares = np.linspace(0.0, 1.0, 9)
    np.testing.assert_allclose(arc.poses(shares)[:, :3, 3], [circle(4.0 * share) for share in shares], atol=1e-10)
    np.testing.assert_allclose(arc.shares, (3.5 / 4.0, 1.0), atol=1e-12)
    piece = arc.piece(0.25, 0.75)
    np.testing.assert_allclose(piece.poses([0.5])[0, :3, 3], circle(2.0), atol=1e-10)


@pytest.mark.parametrize("angle", [2.0 * np.pi, 1.0, -1.0])
def test_a_circular_angle_ends_the_way_there_with_the_end_points_orientation(angle):
    circle = lambda angle: 50.0 * np.array([np.cos(angle), np.sin(angle), 0.0])  # noqa: E731
    turned = Rotation.from_rotvec([0.3, 0.0, 0.0]).as_matrix()
    arc = Arc.of(pose(np.eye(3), circle(0.0)), circle(1.5), pose(turned, circle(3.0)), angle)
    np.testing.assert_allclose(arc.finish, pose(turned, circle(angle)), atol=1e-10)


def test_three_points_on_a_line_are_no_circle():
    at = lambda x: pose(np.eye(3), [x, 500.0, 300.0])  # noqa: E731
    with pytest.raises(ValueError, match="no circle"):
        Arc.of(at(0.0), at(100.0)[:3, 3], at(200.0))


def test_the_bound_holds_at_every_place_of_the_path_and_is_close(nominal, identified, segments, judged):
    start, sent, found = judged
    assert found.followed.all()
    away = np.linalg.norm(robot_on(nominal, identified, sent, start, 601) - places(segments, 601), axis=-1)
    assert (away[:, [0, -1]] < 1e-3).all()
    assert (away.max(axis=1) <= found.bound_mm).all()
    assert (found.bound_mm <= 1.06 * away.max(axis=1) + 0.002).all()
    assert (found.bound_mm > 0.02).all()  # the points are right; the path is not


def test_the_bound_holds_for_a_ripple_of_the_gears_too(nominal, segments, judged):
    """150 waves per turn of A1, 0.1 mm: the line passes several of them between its points."""
    gears = Harmonics(6, orders=(), ripple=((1, 150), (2, 120)))
    robot = RobotModel(nominal.with_parameters(ERRORS), (gears,), np.array([1e-4, 0.0, 5e-5, 5e-5]))
    lines, start = segments[:3], judged[0][:3]
    found = deviations(nominal, robot, lines, lines, start)
    away = np.linalg.norm(robot_on(nominal, robot, lines, start, 401) - places(lines, 401), axis=-1).max(axis=1)
    assert (away <= found.bound_mm).all()
    assert (found.bound_mm <= 1.06 * away + 0.002).all()


@pytest.mark.parametrize("number", [0, 3, 6, 9])
def test_a_divided_path_stays_within_the_tolerance_everywhere(nominal, identified, segments, judged, number):
    tolerance, segment, start = 0.01, segments[number], judged[0][number]
    found = divided(nominal, identified, segment, start, tolerance_mm=tolerance)
    assert found.reached
    assert len(found.sent) >= 2
    wanted = [segment.piece(*ends) for ends in itertools.pairwise(found.shares)]
    away = np.linalg.norm(robot_on(nominal, identified, found.sent, found.q[:-1], 201) - places(wanted, 201), axis=-1)
    assert away.max() <= tolerance


def test_no_two_halves_of_a_divided_path_could_have_stayed_together(nominal, identified, segments, judged):
    found = divided(nominal, identified, segments[0], judged[0][0], tolerance_mm=0.004)
    widths = np.diff(found.shares)
    halves = [i for i in range(len(widths) - 1) if widths[i] == widths[i + 1] and not (found.shares[i] / widths[i]) % 2]
    assert halves
    for number in halves:
        whole = segments[0].piece(found.shares[number], found.shares[number + 2])
        sent = sent_of(nominal, identified, whole, found.q[number])
        assert deviations(nominal, identified, [whole], [sent], found.q[number][None]).bound_mm[0] > 0.004


def test_a_path_that_the_bound_allows_is_not_divided(nominal, identified, segments, judged):
    found = divided(nominal, identified, segments[0], judged[0][0], tolerance_mm=1.0)
    assert found.shares.tolist() == [0.0, 1.0]


def test_a_way_out_of_reach_is_not_followed_and_not_divided(nominal, identified):
    start = nominal.forward(HOME)
    far = Line(start, moved(start, (2000, 0, 0)))
    assert not deviations(nominal, identified, [far], [far], HOME[None]).followed[0]
    found = divided(nominal, identified, far, HOME, tolerance_mm=0.05)
    assert "cannot be followed" in found.reason
    assert (len(found.shares), len(found.sent), len(found.bound_mm), len(found.q)) == (0, 0, 0, 0)


def test_the_posture_along_a_way_is_at_its_share_and_there_is_none_where_the_way_is_out_of_reach(nominal):
    start = nominal.forward(HOME)
    way = Line(start, moved(start, (-60, 300, -120), (0.2, -0.1, 0.3)))
    for share in (0.5, 1.0):
        q = posture_at(nominal, way, HOME, share)
        assert q is not None
        assert np.allclose(nominal.forward(q), way.poses([share])[0], atol=1e-5)
        assert np.abs(q - HOME).max() < 0.6
    assert posture_at(nominal, Line(start, moved(start, (2000, 0, 0))), HOME, 1.0) is None


def test_a_wrist_singularity_on_the_way_shows(nominal, identified):
    across = np.deg2rad([[0.0, -60.0, 80.0, 0.0, 8.0, 0.0], [0.0, -60.0, 80.0, 0.0, -8.0, 0.0]])
    bent = Line(*nominal.forward(np.deg2rad([[0.0, -60.0, 80.0, 0.0, 60.0, 0.0], [0.0, -60.0, 80.0, 0.0, 40.0, 0.0]])))
    through = Line(*nominal.forward(across))
    starts = np.stack([across[0], np.deg2rad([0.0, -60.0, 80.0, 0.0, 60.0, 0.0])])
    found = deviations(nominal, identified, [through, bent], [through, bent], starts)
    assert found.singular[0] < SINGULAR < found.singular[1]
