"""Set-up errors planted in simulated and real measurements are named first; robots without are never refused.

The robots are 4×4 products written here, wrong by what their makers allow; nothing of cellctl's chain is in them.
"""

import csv
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from cellctl.calibration import PoseRows, PositionRows, RowBlocks, Session, SocketRows, Task
from cellctl.formats import RobotFile, nominal_model
from cellctl.kinematics import Link, SerialChain
from cellctl.setup_check import WideFit, check_setup
from cellctl.setup_check._mixed_units import mixed_units
from cellctl.setup_check.hypothesis import Setup
from tests.helpers.own_model import KR5_TABLE

ROOT = Path(__file__).parents[2]
KR5 = RobotFile.load(ROOT / "procedures" / "robots" / "kr5_r1400.yaml")
UR10 = RobotFile.load(ROOT / "procedures" / "robots" / "ur10.yaml")
TRACKER = ROOT.parent / "shared" / "data" / "ur10_tracker" / "measurements_grid.csv"

UR10_TABLE = [(0, 127.3, 0, 90), (0, 0, -612, 0), (0, 0, -572.3, 0), (0, 163.941, 0, 90), (0, 115.7, 0, -90),
              (0, 92.2, 0, 0)]  # fmt: skip
KR5_SIGNS, UR10_SIGNS = np.array([-1, 1, 1, -1, 1, -1]), np.ones(6)


def flanges(table, angles_deg):
    """Flange poses (N, 4, 4) of a table (theta, d, a, alpha) in deg and mm, joint first."""
    reached = np.tile(np.eye(4), (len(angles_deg), 1, 1))
    for (theta, d, a, alpha), angle in zip(table, angles_deg.T, strict=True):
        step = np.tile(np.eye(4), (len(angles_deg), 1, 1))
        turn = Rotation.from_rotvec(np.outer(angle + theta, [0, 0, 1]), degrees=True)
        step[:, :3, :3] = (turn * Rotation.from_euler("x", alpha, degrees=True)).as_matrix()
        step[:, :3, 3] = turn.apply([a, 0, d])
        reached = reached @ step
    return reached


class Measured:
    """Readings (N, 6), deg, and what a tracker says of a reflector on the flange: points and turns in its own frame."""

    def __init__(self, seed, count, robot=KR5, outliers=0, wrong=1.0, still=False):
        rng = np.random.default_rng(seed)
        table, signs = (KR5_TABLE, KR5_SIGNS) if robot is KR5 else (UR10_TABLE, UR10_SIGNS)
        low, high = [-90, -110, 40, -90, -80, -120], [90, -40, 120, 90, 80, 120]
        self.robot = robot
        self.readings = rng.uniform(low, high, (count, 6))
        if still:  # the flange keeps level: its orientation hardly changes
            self.readings[:, 3:] = [0, 60, 0]
            self.readings[:, 4] = 90 - self.readings[:, 1] - self.readings[:, 2]
        true = np.array(table) + wrong * rng.normal(0, [0.03, 0.4, 0.4, 0.04], (6, 4))
        reached = flanges(true, signs * self.readings)
        stand = Rotation.from_quat(rng.normal(size=4))
        reflector = rng.normal([60, 50, 300], 60)
        points = reached[:, :3, :3] @ reflector + reached[:, :3, 3]
        self.xyz = stand.apply(points) + rng.normal([2100, -900, 40], 0.03, (count, 3))
        self.xyz[rng.permutation(count)[:outliers]] += rng.normal(0, 100, (outliers, 3))
        self.turns = stand * Rotation.from_matrix(reached[:, :3, :3]) * Rotation.from_euler("y", 40, degrees=True)


def positions(robot, readings, xyz):
    return Task(nominal_model(robot, touched=False), PositionRows(model_angles(robot, readings), xyz, 0.02 + 0 * xyz))


def poses(robot, readings, xyz, turns):
    measured = np.tile(np.eye(4), (len(xyz), 1, 1))
    measured[:, :3, :3], measured[:, :3, 3] = turns.as_matrix(), xyz
    sigma = np.tile([0.02] * 3 + [1e-4] * 3, (len(xyz), 1))
    return Task(nominal_model(robot, touched=False), PoseRows(model_angles(robot, readings), measured, sigma))


def model_angles(robot, readings):
    return robot.joint_map().model(readings)


def found(task, robot, readings):
    return check_setup(task, robot.joint_map(), readings).errors


def named(task, robot, readings):
    """What is named first, and what as good as it, in words without their figures."""
    return [[change.what for change in error.changes] for error in found(task, robot, readings)]


@pytest.fixture(scope="module")
def kuka():
    return Measured(11, 90)


@pytest.fixture(scope="module")
def universal():
    return Measured(12, 90, robot=UR10)


@pytest.fixture(scope="module")
def tracker():
    """250 real rows of a UR10: readings, deg; points, mm; orientations, Euler XYZ."""
    if not TRACKER.exists():
        pytest.skip(f"the UR10 measurements are not at {TRACKER}")
    with TRACKER.open(newline="") as source:
        rows = list(csv.DictReader(source, delimiter=";"))[::47][:250]

    def columns(*names):
        return np.array([[float(row[name].replace(",", ".")) for name in names] for row in rows])

    joints = [f"{part}_joint" for part in ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")]
    real = Measured(0, 8, robot=UR10)
    real.readings, real.xyz = np.rad2deg(columns(*joints)), columns(*(f"measurement_{axis}" for axis in "xyz"))
    real.angles = columns(*(f"measurement_r{axis}" for axis in "xyz"))
    return real


@pytest.fixture(params=["kuka", pytest.param("tracker" if TRACKER.exists() else "universal", marks=pytest.mark.long)])
def measured(request):
    """A simulated KR5; a real UR10, or a simulated one where its measurements are not at hand."""
    return request.getfixturevalue(request.param)


def changed(readings, **by_joint):
    result = readings.copy()
    for name, change in by_joint.items():
        result[:, int(name[1]) - 1] = change(result[:, int(name[1]) - 1])
    return result


def test_the_evidence_has_the_figures_before_and_after(kuka):
    wrong = changed(kuka.readings, A3=np.negative)
    (error,) = found(positions(KR5, wrong, kuka.xyz), KR5, wrong)
    assert error.before > 300.0 > 2.0 > error.after
    assert error.words() == f"A3 reversed: RMS {error.before:.0f} → {error.after:.2g} mm"
    (change,) = error.changes
    assert (change.source, change.key, change.cure) == ("robot", ("joints", 2, "sign"), "sign: -1 for joint 3")


@pytest.mark.parametrize("joint", [1, 3, 5])
def test_a_reversed_joint_is_named(measured, joint):
    wrong = changed(measured.readings, **{f"A{joint}": np.negative})
    first, *_ = named(positions(measured.robot, wrong, measured.xyz), measured.robot, wrong)
    assert first == [f"A{joint} reversed"]


@pytest.mark.long
@pytest.mark.parametrize(("joint", "by"), [(2, 90.0), (3, -12.0), (4, 180.0)])
def test_a_joint_that_counts_from_another_zero_is_named_with_the_angle(measured, joint, by):
    wrong = changed(measured.readings, **{f"A{joint}": lambda angle: angle + by})
    first, *others = found(positions(measured.robot, wrong, measured.xyz), measured.robot, wrong)
    explained = [error for error in (first, *others) if error.changes[0].what.startswith(f"A{joint} off by")]
    assert explained, "the planted error is neither first nor among its equals"
    (change,) = explained[0].changes
    assert change.key == ("joints", joint - 1, "offset")
    assert abs(float(change.what.split()[-1].rstrip("°")) - abs(by)) < 0.5


def test_no_zero_is_claimed_that_base_or_tool_take_up(measured):
    """Another zero of A1 is another heading of the base; of A6, a turn of the tool."""
    wrong = changed(measured.readings, A1=lambda angle: angle + 90, A6=lambda angle: angle - 45)
    assert named(positions(measured.robot, wrong, measured.xyz), measured.robot, wrong) == []


@pytest.mark.long
@pytest.mark.parametrize("joint", [3, 5])
def test_a_zero_off_by_less_than_two_degrees_is_left_to_the_identification(kuka, joint):
    for by in (1.7, -1.7, 4.0):
        wrong = changed(kuka.readings, **{f"A{joint}": lambda angle, by=by: angle - by})
        errors = named(positions(KR5, wrong, kuka.xyz), KR5, wrong)
        assert bool(errors) == (by == 4.0), errors


@pytest.mark.long
@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"A2": lambda a: a + 20, "A3": lambda a: a - 50}, ["A2 off by 20°", "A3 off by 50°"]),
        ({"A2": np.negative, "A3": lambda a: a + 90}, ["A2 reversed", "A3 off by 90°"]),
        ({"A2": np.negative, "A3": np.negative}, ["A2 reversed", "A3 reversed"]),
    ],
)
def test_two_wrong_joints_are_named_together(measured, wrong, words):
    readings = changed(measured.readings, **wrong)
    first, *_ = named(positions(measured.robot, readings, measured.xyz), measured.robot, readings)
    assert [re.sub(r"[\d.]+(?=°)", lambda angle: f"{float(angle[0]):.0f}", said) for said in first] == words


@pytest.mark.long
def test_three_wrong_joints_are_named_together(kuka):
    readings = changed(kuka.readings, A2=lambda a: a + 20, A3=lambda a: a - 50, A5=lambda a: a + 33)
    first, *_ = named(positions(KR5, readings, kuka.xyz), KR5, readings)
    assert [said.split()[0] for said in first] == ["A2", "A3", "A5"]


@pytest.mark.long
def test_radians_in_columns_of_degrees_are_named(measured):
    wrong = np.deg2rad(measured.readings)
    first = named(positions(measured.robot, wrong, measured.xyz), measured.robot, wrong)[0]
    assert first == ["joint readings are radians in columns of degrees"]


@pytest.mark.long
def test_degrees_in_columns_of_radians_are_named(measured):
    wrong = np.rad2deg(measured.readings)
    first = named(positions(measured.robot, wrong, measured.xyz), measured.robot, wrong)[0]
    assert first == ["joint readings are degrees in columns of radians"]


@pytest.mark.parametrize(("unit", "mm"), [("metres", 1000.0), ("inches", 25.4), ("centimetres", 10.0)])
def test_positions_in_another_unit_are_named(measured, unit, mm):
    task = positions(measured.robot, measured.readings, measured.xyz / mm)
    assert named(task, measured.robot, measured.readings) == [[f"X, Y, Z are {unit}"]]


@pytest.mark.long
@pytest.mark.parametrize("hand", [np.diag([-1, 1, 1]), np.diag([1, 1, -1]), np.eye(3)[[1, 0, 2]]])
def test_a_left_handed_frame_is_named(measured, hand):
    task = positions(measured.robot, measured.readings, measured.xyz @ hand)
    assert named(task, measured.robot, measured.readings)[0] == ["the measuring frame is left-handed"]


def test_where_a_mirror_and_three_signs_explain_as_much_both_are_named(kuka):
    """The KR5 is symmetric but for its tool: with all its signs 1, everything happens in a mirror."""
    wrong = changed(kuka.readings, A1=np.negative, A4=np.negative, A6=np.negative)
    assert named(positions(KR5, wrong, kuka.xyz), KR5, wrong) == [
        ["the measuring frame is left-handed"],
        ["A1 reversed", "A4 reversed", "A6 reversed"],
    ]


def test_swapped_columns_of_joints_are_named(measured):
    wrong = measured.readings[:, [0, 2, 1, 3, 4, 5]]
    first = named(positions(measured.robot, wrong, measured.xyz), measured.robot, wrong)[0]
    assert first == ["columns A2 and A3 are swapped"]


@pytest.mark.long
@pytest.mark.parametrize("by", [1, -3, 5])
def test_measurements_out_of_step_in_all_rows_are_named(measured, by):
    wrong = np.roll(measured.readings, by, axis=0)
    ((what,), *_) = named(positions(measured.robot, wrong, measured.xyz), measured.robot, wrong)
    which = "the row" if abs(by) == 1 else f"{abs(by)} rows"
    side = "after" if by > 0 else "before"
    assert what == f"in all rows the measurements belong to the joints of {which} {side}"


@pytest.mark.long
@pytest.mark.parametrize("share", [0.15, 0.5, 0.8])
def test_the_row_from_which_on_measurements_are_out_of_step_is_named(measured, share):
    start = int(share * len(measured.readings))
    wrong = measured.readings.copy()
    wrong[start:] = measured.readings[start - 1 : -1]
    (error, *_) = found(positions(measured.robot, wrong, measured.xyz), measured.robot, wrong)
    (change,) = error.changes
    assert change.what == "from {0} on the measurements belong to the joints of the row after"
    assert abs(change.rows[0] - start) <= 1
    assert error.after < 2.0 < 20.0 < error.before


def test_two_exchanged_rows_are_named(measured):
    wrong = measured.readings.copy()
    wrong[[12, 37]] = wrong[[37, 12]]
    (error,) = found(positions(measured.robot, wrong, measured.xyz), measured.robot, wrong)
    assert error.changes[0].words("row {}".format) == "the measurements of row 12 and row 37 are exchanged"


@pytest.mark.long
@pytest.mark.parametrize("sequence", ["XYZ", "xyz", "YZX"])
def test_euler_angles_in_another_order_are_named(kuka, sequence):
    read = Rotation.from_euler("ZYX", kuka.turns.as_euler(sequence, degrees=True), degrees=True)
    first = named(poses(KR5, kuka.readings, kuka.xyz, read), KR5, kuka.readings)[0]
    axes = "turned" if sequence.isupper() else "fixed"
    assert first == [f"A, B, C are {sequence.upper()} angles, about the {axes} axes"]


@pytest.mark.long
def test_the_order_of_real_euler_angles_is_found(tracker):
    read = Rotation.from_euler("ZYX", tracker.angles, degrees=True)
    errors = found(poses(UR10, tracker.readings, tracker.xyz, read), UR10, tracker.readings)
    assert errors[0].unit == "°"
    assert errors[0].changes[0].what.startswith("A, B, C are XYZ angles")


@pytest.mark.long
def test_orientations_in_radians_as_rotation_vectors_or_inverse_are_named(kuka):
    said = {
        "A, B, C are radians": Rotation.from_euler("ZYX", kuka.turns.as_euler("ZYX"), degrees=True),
        "A, B, C are a rotation vector in radians": Rotation.from_euler("ZYX", kuka.turns.as_rotvec(), degrees=True),
        "orientations are inverse: from tool to frame": kuka.turns.inv(),
    }
    for words, read in said.items():
        assert named(poses(KR5, kuka.readings, kuka.xyz, read), KR5, kuka.readings)[0] == [words]


@pytest.mark.long
def test_of_poses_the_mirrored_axis_is_named(kuka):
    swapped = poses(KR5, kuka.readings, kuka.xyz[:, [1, 0, 2]], kuka.turns)
    mirrored = poses(KR5, kuka.readings, kuka.xyz * [1, 1, -1], kuka.turns)
    assert named(swapped, KR5, kuka.readings)[0] == ["the measuring frame is left-handed: X and Y are swapped"]
    assert named(mirrored, KR5, kuka.readings)[0] == ["the measuring frame is left-handed: Z is reversed"]


def with_links(task, convention, scale=1.0):
    chain = task.model.chain
    links = [Link(row.theta, scale * row.d, scale * row.a, row.alpha, row.beta) for row in chain.table.links]
    return replace(task, model=replace(task.model, chain=SerialChain.from_links(convention, links)))


@pytest.mark.long
def test_a_table_in_the_other_convention_is_named(measured):
    task = with_links(positions(measured.robot, measured.readings, measured.xyz), "dh-craig")
    first = found(task, measured.robot, measured.readings)[0].changes[0]
    assert first.what == "the link table is in standard DH and read as Craig's modified DH"
    assert first.cure == "convention: mdh-hayati"


@pytest.mark.long
def test_link_lengths_in_metres_are_named(measured):
    task = with_links(positions(measured.robot, measured.readings, measured.xyz), "mdh-hayati", 0.001)
    assert named(task, measured.robot, measured.readings) == [["link lengths are metres"]]


@pytest.mark.long
def test_two_errors_of_different_kinds_are_named_together(kuka):
    wrong = changed(kuka.readings, A2=np.negative)
    assert named(positions(KR5, wrong, kuka.xyz / 1000), KR5, wrong)[0] == ["X, Y, Z are metres", "A2 reversed"]


@pytest.mark.long
@pytest.mark.parametrize("outliers", [3, 25])
def test_outliers_hide_no_error(outliers):
    data = Measured(21, 80, outliers=outliers)
    wrong = changed(data.readings, A3=np.negative)
    assert named(positions(KR5, wrong, data.xyz), KR5, wrong)[0] == ["A3 reversed"]


@pytest.mark.long
def test_twenty_rows_are_enough_for_a_sign():
    data = Measured(22, 20)
    wrong = changed(data.readings, A2=np.negative)
    assert named(positions(KR5, wrong, data.xyz), KR5, wrong)[0] == ["A2 reversed"]


@pytest.mark.parametrize("joint", [2, 3, 4])
def test_touches_name_a_reversed_joint(touches, touch_task, joint):
    wrong = replace(touches, readings=changed(touches.readings, **{f"A{joint}": np.negative}))
    assert named(touch_task(wrong), KR5, wrong.readings)[0] == [f"A{joint} reversed"]


def test_touches_name_radians(touches, touch_task):
    """Tips that hardly move lie on a sphere of any size: it is the spheres' rough places that tell."""
    wrong = replace(touches, readings=np.deg2rad(touches.readings))
    first = named(touch_task(wrong), KR5, wrong.readings)[0]
    assert first == ["joint readings are radians in columns of degrees"]


@pytest.mark.parametrize(
    ("factor", "words"),
    [
        (0.001, "radii are metres"),
        (0.5, "radii are given as diameters"),
        (2.0, "diameters are given as radii"),
    ],
)
def test_touches_name_spheres_of_another_size(touches, touch_task, factor, words):
    task = touch_task(touches)
    other = replace(task, rows=replace(task.rows.only, reach=factor * task.rows.only.reach))
    assert named(other, KR5, touches.readings)[0] == [f"spheres: {words}"]


@pytest.mark.long
def test_healthy_robots_are_never_refused():
    """20 robots, each by positions, by poses, in 20 rows, with outliers, three times as wrong as tolerances allow."""
    for seed in range(20):
        usual, sample = Measured(seed, 60), Measured(seed, 20)
        with_outliers, bad = (
            Measured(seed, 60, outliers=(2, 6, 18, 24)[seed % 4]),
            Measured(seed, 60, wrong=3.0, robot=UR10),
        )
        for data in (usual, sample, with_outliers, bad):
            assert named(positions(data.robot, data.readings, data.xyz), data.robot, data.readings) == []
        assert named(poses(KR5, usual.readings, usual.xyz, usual.turns), KR5, usual.readings) == []


@pytest.mark.long
def test_robots_of_constant_orientation_are_never_refused():
    for seed in range(50):
        data = Measured(seed, 40, still=True)
        assert named(positions(KR5, data.readings, data.xyz), KR5, data.readings) == []


def test_real_robots_are_not_refused(tracker):
    assert named(positions(UR10, tracker.readings, tracker.xyz), UR10, tracker.readings) == []
    turns = Rotation.from_euler("XYZ", tracker.angles, degrees=True)
    assert named(poses(UR10, tracker.readings, tracker.xyz, turns), UR10, tracker.readings) == []


@pytest.mark.long
def test_touches_are_not_refused(touches, touch_task, draw):
    assert named(touch_task(touches), KR5, touches.readings) == []
    for seed in range(3):
        one = draw(seed, 30, spheres=[[950.0, -350.0, 250.0]])
        assert named(touch_task(one), KR5, one.readings) == []


@pytest.fixture(scope="module")
def socketed():
    """Readings that put the tip of a KR5 with errors at one of two points, with many orientations, and which point."""
    rng = np.random.default_rng(41)
    true = np.array(KR5_TABLE) + rng.normal(0, [0.03, 0.4, 0.4, 0.04], (6, 4))
    tool, points = np.array(KR5.tool.xyz), np.array([[950.0, -100.0, 250.0], [950.0, 100.0, 250.0]])

    def tcps(readings):
        reached = flanges(true, KR5_SIGNS * readings)
        return reached[:, :3, :3] @ tool + reached[:, :3, 3]

    readings, which = [], np.arange(60) % 2
    for index in which:
        start = np.array([0.0, -70.0, 80.0, 0.0, 60.0, 0.0]) + rng.uniform(-25, 25, 6) * [1, 1, 1, 2, 1, 4]

        def away(arm, wrist=start[3:], point=points[index]):
            return tcps(np.array([[*arm, *wrist]]))[0] - point

        arm = least_squares(away, start[:3], xtol=1e-12).x
        readings.append([*arm, *start[3:]])
    rows = np.array(readings)
    assert np.abs(tcps(rows) - points[which]).max() < 1e-6
    return rows, which


def sockets(readings, which):
    rows = SocketRows(model_angles(KR5, readings), which, np.full((len(which), 3), 0.03))
    return Task(nominal_model(KR5, touched=False), rows, ("left", "right"))


@pytest.mark.long
def test_sockets_are_not_refused_and_name_a_reversed_or_offset_joint(socketed):
    readings, which = socketed
    assert named(sockets(readings, which), KR5, readings) == []
    wrong = changed(readings, A3=np.negative)
    assert named(sockets(wrong, which), KR5, wrong)[0] == ["A3 reversed"]
    wrong = changed(readings, A5=lambda angle: angle + 90)
    assert named(sockets(wrong, which), KR5, wrong)[0] == ["A5 off by 90.0°"]


@pytest.mark.long
def test_random_numbers_are_no_set_up_error():
    data = Measured(31, 60)
    noise = np.random.default_rng(31).normal(0, 500, (60, 3))
    setup = check_setup(positions(KR5, data.readings, noise), KR5.joint_map(), data.readings)
    assert setup.implausible
    assert setup.errors == ()


def wide_fit(task, robot, readings):
    return WideFit.of(Setup(task, robot.joint_map(), readings))


@pytest.mark.long
def test_the_file_of_another_robot_does_not_belong_to_the_rows():
    data = Measured(2, 150, robot=UR10)
    fit = wide_fit(positions(KR5, data.readings, data.xyz), KR5, data.readings)
    assert fit.unrelated
    assert fit.systematic > 0.5
    assert fit.left_mm > 5.0


@pytest.mark.long
def test_another_robot_of_the_same_family_is_recognised_by_its_lengths():
    data = Measured(13, 60, robot=UR10)
    for name, wrong in {"ur5": {"a2": -187.0, "a3": -180.05}, "ur16e": {"a2": -133.6, "a3": -212.3}}.items():
        robot = RobotFile.load(ROOT / "procedures" / "robots" / f"{name}.yaml")
        setup = check_setup(positions(robot, data.readings, data.xyz), robot.joint_map(), data.readings)
        assert setup.errors == ()
        assert setup.wide_fit.impossible
        found = {each.parameter.label: each for each in setup.wide_fit.wrong_lengths}
        for label, deviation in wrong.items():
            assert abs(found[label].deviation_mm - deviation) < 2.0 + 3.0 * found[label].sigma_mm


def test_measurements_shuffled_against_their_joints_do_not_belong_to_the_robot():
    data = Measured(52, 60)
    fit = wide_fit(positions(KR5, data.readings, data.xyz[::-1]), KR5, data.readings)
    assert fit.unrelated
    assert fit.systematic < 0.5  # nothing but chance ties them to the joints


def test_a_bad_robot_is_this_robot_all_the_same():
    """Two joints that lost their mastering by 5°, links as a tape measures them, outliers, and a poor instrument."""
    data = Measured(53, 60, outliers=6, wrong=20.0)
    readings = data.readings + np.array([0, 5, 0, -5, 0, 0])
    noisy = data.xyz + np.random.default_rng(53).normal(0, 1.0, data.xyz.shape)
    fit = wide_fit(positions(KR5, readings, noisy), KR5, readings)
    assert not fit.unrelated
    assert not fit.impossible
    assert fit.left_mm < 3.0


def test_touches_with_a_tool_off_by_a_decimetre_are_this_robot_all_the_same(touches, touch_task):
    task = touch_task(touches)
    tool = task.model.chain.tool_now.copy()
    tool[:3, 3] += [60.0, -60.0, 60.0]
    other = replace(task, model=replace(task.model, chain=task.model.chain.with_tool(tool)))
    assert not wide_fit(other, KR5, touches.readings).unrelated


@pytest.mark.long
def test_healthy_bad_and_noisy_robots_belong_to_their_rows():
    """20 robots, each as it is; 5 and 15 times as wrong as tolerances; with lost mastering; in 10 mm of noise."""
    for seed in range(20):
        usual, bad = Measured(seed, 60, outliers=seed % 20), Measured(seed, 40, wrong=15.0, robot=UR10)
        lost = usual.readings + np.random.default_rng(seed).uniform(-10, 10, 6)
        noisy = usual.xyz + np.random.default_rng(seed).normal(0, 10.0, usual.xyz.shape)
        assert not wide_fit(positions(KR5, usual.readings, usual.xyz), KR5, usual.readings).unrelated
        assert not wide_fit(positions(UR10, bad.readings, bad.xyz), UR10, bad.readings).unrelated
        worst = Measured(seed, 40, wrong=5.0, robot=UR10)
        assert not wide_fit(positions(UR10, worst.readings, worst.xyz), UR10, worst.readings).impossible
        of_lost = wide_fit(positions(KR5, lost, usual.xyz), KR5, lost)
        assert not of_lost.unrelated
        assert not of_lost.wrong_lengths
        assert not wide_fit(positions(KR5, usual.readings, noisy), KR5, usual.readings).unrelated


@pytest.mark.long
def test_other_robots_and_shuffled_rows_do_not_belong_together():
    for seed in range(10):
        other, right = Measured(seed, 150, robot=UR10), Measured(seed, 40)
        mixed = right.xyz[np.random.default_rng(seed).permutation(40)]
        assert wide_fit(positions(KR5, other.readings, other.xyz), KR5, other.readings).unrelated
        assert wide_fit(positions(KR5, right.readings, mixed), KR5, right.readings).unrelated


@pytest.mark.long
def test_rows_out_of_step_are_named_in_each_session_by_itself():
    """Two set-ups of the instrument; in the first rows lag by one from row 12 on, in the second by two throughout."""
    first, second = Measured(54, 30), Measured(54, 30)
    turn = Rotation.from_euler("z", 70, degrees=True)
    late = np.r_[np.arange(12), np.arange(13, 30), 29]
    readings = np.concatenate([first.readings, second.readings[np.r_[2:30, 0, 1]]])
    xyz = [first.xyz[late], turn.apply(second.xyz) + 300.0]
    blocks = [
        replace(PositionRows(model_angles(KR5, part), points, 0.02 + 0 * points), session=number)
        for number, (part, points) in enumerate(zip(np.split(readings, 2), xyz, strict=True))
    ]
    sessions = (Session("a"), Session("b", frozenset({"base"})))
    task = Task(nominal_model(KR5, touched=False), RowBlocks(tuple(blocks)), sessions=sessions)
    changes = found(task, KR5, readings)[0].changes
    assert [change.what for change in changes] == [
        "from {0} on the measurements belong to the joints of the row after",
        "in all rows of session b the measurements belong to the joints of 2 rows before",
    ]
    assert changes[0].rows[0] == 12


def test_a_number_that_no_arithmetic_survives_names_nothing(kuka):
    xyz = kuka.xyz.copy()
    xyz[7, 1] = 1e300
    assert not found(positions(KR5, kuka.readings, xyz), KR5, kuka.readings)


METRES, INCHES = 1000.0, 25.4
HALF, TEN, FIVE = np.arange(20, 40), np.arange(3, 40, 4), np.arange(5)


def in_lines(error):
    """What is said, rows called by their number, and which: first and last of each stretch that is named."""
    (change,) = error.changes
    return change.words("{}".format).partition(" X, ")[0].partition(" Y l")[0].partition(" A1…")[0], change.what


@pytest.mark.parametrize("robot", [pytest.param(KR5, id="kr5"), pytest.param(UR10, id="ur10", marks=pytest.mark.long)])
@pytest.mark.parametrize(("mm", "unit"), [(METRES, "metres (× 1000)"), (INCHES, "inches (× 25.4)")])
@pytest.mark.parametrize(
    ("rows", "which"), [(HALF, "in 20 to 39"), (TEN, "in 3, 7, 11, … (10 rows)"), (FIVE, "in 0 to 4")]
)
def test_positions_of_some_rows_in_another_unit_are_named_by_row(robot, mm, unit, rows, which):
    data = Measured(31, 40, robot=robot)
    data.xyz[rows] /= mm
    (error,) = found(positions(robot, data.readings, data.xyz), robot, data.readings)
    said, what = in_lines(error)
    assert (said, what.partition(" X, ")[2]) == (which, f"Y, Z look like {unit}")
    assert error.before > 100.0 > 3.0 > error.after


@pytest.mark.long
def test_one_coordinate_in_metres_is_named_in_some_rows_or_in_all():
    some, every = Measured(32, 40), Measured(32, 40)
    some.xyz[HALF, 1] /= METRES
    every.xyz[:, 2] /= METRES
    told = [found(positions(KR5, data.readings, data.xyz), KR5, data.readings) for data in (some, every)]
    assert in_lines(told[0][0]) == ("in 20 to 39", "in {0} to {1} Y looks like metres (× 1000)")
    assert told[1][0].changes[0].what == "in all rows Z looks like metres (× 1000)"


def test_poses_of_some_rows_in_metres_are_named():
    data = Measured(33, 40)
    data.xyz[HALF] /= METRES
    (error,) = found(poses(KR5, data.readings, data.xyz, data.turns), KR5, data.readings)
    assert in_lines(error)[0] == "in 20 to 39"


@pytest.mark.parametrize(("rows", "which"), [(HALF, "in 20 to 39"), (TEN, "in 3, 7, 11, … (10 rows)")])
def test_joints_of_some_rows_in_radians_are_named(rows, which):
    data = Measured(34, 40)
    data.readings[rows] = np.deg2rad(data.readings[rows])
    (error,) = found(positions(KR5, data.readings, data.xyz), KR5, data.readings)
    assert in_lines(error) == (
        which,
        f"{error.changes[0].what.partition(' A1')[0]} A1…A6 look like radians (× 180/π)",
    )


def test_of_rows_in_metres_outliers_are_not_named():
    data = Measured(35, 40, outliers=4)
    data.xyz[HALF] /= METRES
    (error,) = found(positions(KR5, data.readings, data.xyz), KR5, data.readings)
    assert "look like metres" in error.changes[0].what
    assert error.after < 3.0


@pytest.mark.long
def test_no_sound_row_looks_like_another_unit_even_where_all_are_asked():
    """Asked outright, whatever nominal is like: sound sets, outliers, robots three times as bad, a frame amid them."""
    for seed in range(3):
        usual, with_outliers = Measured(seed, 50), Measured(seed, 50, outliers=20, wrong=3.0, robot=UR10)
        amid = Measured(seed, 50)
        amid.xyz -= amid.xyz.mean(axis=0)
        for data in (usual, with_outliers, amid):
            setup = Setup(positions(data.robot, data.readings, data.xyz), data.robot.joint_map(), data.readings)
            assert list(mixed_units(setup)) == []
