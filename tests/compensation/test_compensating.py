"""Compensated joints take the *identified* robot to the target; a robot of the test's own says what that is."""

import numpy as np
import pytest

from cellctl.calibration import RobotModel, ToolDeflection, gauge_fixed, sigma_among
from cellctl.compensation import compensate, postures, with_geometry
from cellctl.kinematics import Link, SerialChain, pose_from_xyz_abc
from tests.helpers.arms import KR5_LINKS
from tests.helpers.own_model import KR5_TABLE

TOOL = ([59.9, 50.5, 410.3], [38.8, 3.6, 0.0])
ERRORS = {
    "theta2": 0.003, "theta3": -0.004, "theta5": 0.002, "d4": 0.8, "a2": -0.7, "alpha1": 0.0006, "beta2": -0.0005,
    "alpha4": 0.0009, "d5": 0.9, "tool_x": 0.8, "tool_y": -1.1, "tool_z": 0.6,
}  # fmt: skip
EXACT = ("pseudo-target", "pseudo-target-matrix", "veitschegger-wu", "newton-raphson")
"""Methods that reach position and orientation of every target."""
HOME = np.deg2rad([0.0, -60.0, 80.0, 10.0, 60.0, 20.0])
DEFLECTION, C_T = ToolDeflection(0.41, 15.0), 0.00036


@pytest.fixture(scope="module")
def nominal():
    return SerialChain.from_links("mdh-hayati", KR5_LINKS, None, pose_from_xyz_abc(*TOOL))


@pytest.fixture(scope="module")
def identified(nominal):
    return RobotModel(nominal.with_parameters(ERRORS), (DEFLECTION,), np.array([C_T]))


@pytest.fixture(scope="module")
def postures_near_home():
    return HOME + np.random.default_rng(2).uniform(-0.4, 0.4, (60, 6))


def turn(axis, angle):
    c, s = np.cos(angle), np.sin(angle)
    matrix = np.eye(4)
    i, j = [(1, 2), (2, 0), (0, 1)][axis]
    matrix[i, i] = matrix[j, j] = c
    matrix[i, j], matrix[j, i] = -s, s
    return matrix


def slide(axis, by):
    matrix = np.eye(4)
    matrix[axis, 3] = by
    return matrix


def real_tool(q):
    """Where the robot with `ERRORS` has its tool: 4×4 products written out here, none of ours."""
    matrix = np.eye(4)
    for index, (theta, d, a, alpha) in enumerate(KR5_TABLE):
        number = index + 1
        error = lambda name, number=number: ERRORS.get(f"{name}{number}", 0.0)  # noqa: E731
        matrix = matrix @ turn(2, q[index] + np.deg2rad(theta) + error("theta")) @ slide(2, d + error("d"))
        matrix = matrix @ slide(0, a + error("a")) @ turn(0, np.deg2rad(alpha) + error("alpha"))
        matrix = matrix @ turn(1, error("beta"))
    axis = matrix[:3, 2].copy()
    tool = pose_from_xyz_abc(*TOOL)
    for place, letter in enumerate("xyz"):
        tool = tool @ slide(place, ERRORS.get(f"tool_{letter}", 0.0))
    matrix = matrix @ tool
    sag = 1000.0 * C_T * DEFLECTION.length_m**3 / 3.0 * DEFLECTION.load_n
    matrix[:3, 3] += sag * (np.array([0.0, 0.0, -1.0]) + axis[2] * axis)
    return matrix


@pytest.mark.parametrize("method", EXACT)
def test_the_real_robot_is_at_the_target_with_compensated_joints_and_millimetres_off_with_nominal_ones(
    nominal, identified, postures_near_home, method
):
    targets = nominal.forward(postures_near_home)
    found = compensate(nominal, identified, targets, postures_near_home + 0.01, method=method)
    assert found.converged.all()
    for target, before, after in zip(targets, found.nominal_q, found.compensated_q, strict=True):
        assert np.linalg.norm(real_tool(before)[:3, 3] - target[:3, 3]) > 0.5
        np.testing.assert_allclose(real_tool(after), target, atol=2e-4)


def test_the_predicted_distances_are_those_of_the_real_robot(nominal, identified, postures_near_home):
    targets = nominal.forward(postures_near_home)
    found = compensate(nominal, identified, targets, postures_near_home)
    before = [np.linalg.norm(real_tool(q)[:3, 3] - t[:3, 3]) for q, t in zip(found.nominal_q, targets, strict=True)]
    # the model bends its tool as it would hang from the nominal robot: arc minutes of that are 0.2 µm
    np.testing.assert_allclose(found.predicted_before_mm, before, atol=3e-4)
    assert found.predicted_after_mm.max() <= 1e-6


@pytest.mark.parametrize("method", EXACT)
def test_one_pass_leaves_micrometres(nominal, identified, postures_near_home, method):
    targets = nominal.forward(postures_near_home)
    found = compensate(nominal, identified, targets, postures_near_home, method=method, passes=1)
    assert found.passes == 1
    assert np.median(found.predicted_after_mm) < 0.01
    assert found.predicted_after_mm.max() < 0.05


@pytest.mark.parametrize("method", EXACT)
def test_one_pass_leaves_less_than_two_micrometres_of_tenths_of_a_millimetre(nominal, postures_near_home, method):
    small = RobotModel(nominal.with_parameters({name: 0.1 * value for name, value in ERRORS.items()}))
    targets = nominal.forward(postures_near_home)
    found = compensate(nominal, small, targets, postures_near_home, method=method, passes=1)
    assert 0.1 < found.predicted_before_mm.mean() < 1.0
    assert found.predicted_after_mm.max() < 0.002


@pytest.mark.parametrize("method", ["veitschegger-wu", "newton-raphson"])
def test_errors_of_joint_zeros_alone_are_subtracted_once(nominal, postures_near_home, method):
    zeros = {"theta2": 0.003, "theta5": -0.002}
    robot = RobotModel(nominal.with_parameters(zeros))
    targets = nominal.forward(postures_near_home)
    found = compensate(nominal, robot, targets, postures_near_home, method=method)
    expected = found.nominal_q - [0.0, 0.003, 0.0, 0.0, -0.002, 0.0]
    np.testing.assert_allclose(found.compensated_q, expected, atol=1e-9)
    assert found.converged.all()
    before = np.linalg.norm(robot.tcp(found.nominal_q) - targets[:, :3, 3], axis=1)
    np.testing.assert_allclose(found.error_mm[0], before, atol=1e-9)


def test_nominal_joints_are_what_a_controller_without_corrections_computes(nominal, identified, postures_near_home):
    targets = nominal.forward(postures_near_home)
    found = compensate(nominal, identified, targets, postures_near_home + 0.02)
    np.testing.assert_allclose(found.nominal_q, postures_near_home, atol=1e-8)


def test_a_robot_as_its_table_says_is_not_corrected(nominal, postures_near_home):
    found = compensate(nominal, RobotModel(nominal), nominal.forward(postures_near_home), postures_near_home)
    assert found.passes == 0
    np.testing.assert_array_equal(found.nominal_q, found.compensated_q)


@pytest.mark.parametrize("method", EXACT)
def test_a_target_out_of_reach_is_reported_and_its_neighbours_are_compensated(
    nominal, identified, postures_near_home, method
):
    targets = nominal.forward(postures_near_home[:3])
    targets[1, :3, 3] = [5000.0, 0.0, 0.0]
    found = compensate(nominal, identified, targets, postures_near_home[:3], method=method)
    assert found.converged.tolist() == [True, False, True]
    assert [bool(reason) for reason in found.reasons] == [False, True, False]
    assert found.predicted_after_mm[[0, 2]].max() <= 1e-6
    assert np.isfinite(found.compensated_q).all()


def test_a_robot_of_seven_joints_is_compensated_too():
    links = [
        Link(0, d, 0, alpha)
        for d, alpha in zip([360, 0, 420, 0, 400, 0, 126], np.deg2rad([-90, 90, 90, -90, -90, 90, 0]), strict=True)
    ]
    chain = SerialChain.from_links("mdh-hayati", links)
    q = np.deg2rad([[10, 40, -20, -60, 30, 50, 5.0]])
    identified = RobotModel(chain.with_parameters({"theta2": 0.002, "d5": 0.7}))
    found = compensate(chain, identified, chain.forward(q), q)
    assert found.converged.all()
    np.testing.assert_allclose(identified.pose(found.compensated_q), chain.forward(q), atol=2e-4)


def test_geometry_in_the_controller_takes_over_what_it_can_of_a_deflection(nominal, identified, postures_near_home):
    over, judged = postures_near_home[:40], postures_near_home[40:]

    def rms(chain):
        return np.sqrt(np.mean((identified.tcp(judged) - chain.forward(judged)[:, :3, 3]) ** 2))

    as_identified = rms(nominal.with_parameters(ERRORS))
    assert as_identified > 0.02
    assert rms(with_geometry(nominal, identified, over)) < 0.5 * as_identified


def test_an_unknown_method_is_refused(nominal, identified):
    with pytest.raises(ValueError, match="'newton' is not known"):
        compensate(nominal, identified, np.eye(4)[None], HOME[None], method="newton")


def test_frames_that_count_from_different_poses_are_refused(nominal, identified, postures_near_home):
    moved = RobotModel(identified.chain.with_base(pose_from_xyz_abc([10, 0, 0], [0, 0, 0])))
    with pytest.raises(ValueError, match="base or tool"):
        compensate(nominal, moved, nominal.forward(postures_near_home), postures_near_home)


def test_postures_found_alone_reach_every_target_within_the_box(nominal, postures_near_home):
    targets = nominal.forward(postures_near_home)
    low, high = HOME - 0.45, HOME + 0.45
    found = postures(nominal, targets, low, high)
    assert ((found >= low) & (found <= high)).all()
    np.testing.assert_allclose(nominal.forward(found), targets, atol=1e-5)


def test_where_no_posture_reaches_there_is_none(nominal):
    targets = np.stack([nominal.forward(HOME), pose_from_xyz_abc([5000, 0, 0], [0, 0, 0])])
    found = postures(nominal, targets, HOME - 0.45, HOME + 0.45)
    assert np.isfinite(found[0]).all()
    assert np.isnan(found[1]).all()


def test_what_is_in_the_gauge_does_not_count_and_everything_else_does():
    names = ("theta1", "d1", "a2", "a3")
    mixing = np.random.default_rng(1).normal(size=(4, 4))
    covariance = mixing @ mixing.T
    fixed = gauge_fixed(covariance, names)
    np.testing.assert_allclose(fixed[:2], 0.0, atol=1e-12)
    np.testing.assert_allclose(np.linalg.inv(fixed[2:, 2:]), np.linalg.inv(covariance)[2:, 2:])


def test_a_gauge_that_was_held_changes_nothing():
    covariance = np.diag([0.0, 0.0, 2.0])
    np.testing.assert_array_equal(gauge_fixed(covariance, ("theta1", "d1", "a2")), covariance)


def test_the_sigma_of_points_among_themselves_is_what_a_best_fit_leaves_of_random_models(nominal, postures_near_home):
    rng = np.random.default_rng(5)
    sigma = np.where(nominal.parameter_turns, 2e-4, 0.2)
    names = nominal.parameters
    covariance = np.diag(sigma**2)
    q = postures_near_home[:12]
    tips = nominal.forward(q)[:, :3, 3]
    squares = []
    for _ in range(400):
        errors = dict(zip(names, rng.normal(0.0, sigma), strict=True))
        squares.append(np.mean(best_fit_rest(nominal.with_parameters(errors).forward(q)[:, :3, 3], tips) ** 2))
    assert sigma_among(RobotModel(nominal), covariance, q) == pytest.approx(np.sqrt(np.mean(squares)), rel=0.05)


def test_where_the_base_stands_is_no_error_of_points_among_themselves(nominal, postures_near_home):
    sigma = np.array([1.0 if name.startswith("base_") else 0.0 for name in nominal.parameters])
    assert sigma_among(RobotModel(nominal), np.diag(sigma**2), postures_near_home) < 1e-6


def test_three_points_have_no_shape(nominal, postures_near_home):
    with pytest.raises(ValueError, match="3 points"):
        sigma_among(RobotModel(nominal), np.eye(len(nominal.parameters)), postures_near_home[:3])


def best_fit_rest(points, onto):
    """Distances (N,) after the best rigid motion of `points` onto `onto` (Kabsch)."""
    a, b = points - points.mean(axis=0), onto - onto.mean(axis=0)
    u, _, vt = np.linalg.svd(b.T @ a)
    turned = a @ (u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt).T
    return np.linalg.norm(turned - b, axis=1)
