"""A maker's calibration as the nominal robot: `calibration.conf` and link poses, against their own products."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
import yaml

from cellctl.formats import RobotFile
from tests.helpers.arms import cellctl, library_robot, perturbed
from tests.helpers.own_model import X, Y, Z, slide, turn
from tests.helpers.ur import FACTORY_DH, tool0

UR3_CONF = """[mounting]
delta_theta = [ 9.14361764983717684e-08, 0.178461025123001604, 6.68283349819805572, -0.578116982609792496, \
6.11299818305960363e-06, -5.03926212855332345e-07]
delta_a = [ -0.000243788991999517813, 0.00381165418642351317, 0.034503078453104935, 0.000107694612896758047, \
-0.000198736633205663144, 0]
delta_d = [ 9.225352853908797e-05, 12.0620003757611567, 17.6719025641737275, -29.7339960369544869, \
-2.8164617795367608e-05, 0.000217420471082099831]
delta_alpha = [ 0.00115615746589403656, 0.0035851898103369975, 0.00392132336586574568, 0.000406668888106365145, \
-0.00201170396009153762, 0]
joint_checksum = [ 0xb3241580, 0xb10112f1, 0x290cac88, 0xa8d3f155, 0xa8b7e9eb, 0xa8dbbfa3]
calibration_status = 2 # 0 == notInitialized / 1 == notLinearised / 2 == Linearised
"""
"""Of a real UR3: github.com/MyRobotLab/pyrobotlab, issue 145."""

UR3_ROWS = [
    (0, 151.9, 0, 90),
    (0, 0, -243.65, 0),
    (0, 0, -213.25, 0),
    (0, 112.35, 0, 90),
    (0, 85.35, 0, -90),
    (0, 81.9, 0, 0),
]
"""theta, d, a, alpha of the maker's table, deg and mm."""

XARM = {
    "xarm6": [
        (0, 0, 0.267, 0), (0, 0, 0, -1), (0.053, -0.2845, 0, 0), (0.0775, 0.3425, 0, -1), (0, 0, 0, 1),
        (0.076, 0.097, 0, -1),
    ],
    "xarm7": [
        (0, 0, 0.267, 0), (0, 0, 0, -1), (0, -0.293, 0, 1), (0.0525, 0, 0, 1), (0.0775, -0.3425, 0, 1), (0, 0, 0, 1),
        (0.076, 0.097, 0, -1),
    ],
}  # fmt: skip
"""x, y, z, m, and the quarter turns about x, of each joint in xarm_description's default kinematics."""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def converted(file, robot, *, to="mdh-hayati"):
    assert cellctl("convert", file, "--robot", robot, "--to", to, "-o", "robot.yaml") == 0
    return RobotFile.load(Path("robot.yaml"))


def flange_by_rows(rows, readings):
    """theta (rad), d, a (mm), alpha (rad) of each joint, chained."""
    here = np.eye(4)
    for (theta, d, a, alpha), reading in zip(rows, readings, strict=True):
        here = here @ turn(Z, theta + math.radians(reading)) @ slide([a, 0, d]) @ turn(X, alpha)
    return here


def conf_of(rows, sheet):
    """`calibration.conf` of rows (theta, d, a, alpha; rad, mm) and the maker's (deg, mm)."""
    differences = np.array(rows) - np.array([(math.radians(t), d, a, math.radians(alpha)) for t, d, a, alpha in sheet])
    names = dict(zip(("theta", "d", "a", "alpha"), differences.T * [[1], [1e-3], [1e-3], [1]], strict=True))
    lines = [f"delta_{name} = [ {', '.join(map(repr, values.tolist()))} ]" for name, values in names.items()]
    return "\n".join(["[mounting]", *lines, "calibration_status = 2", ""])


def assert_same_flange(robot, flange, seed=1, count=200):
    chain = robot.chain()
    for readings in np.random.default_rng(seed).uniform(-180.0, 180.0, (count, robot.n)):
        found, wanted = chain.forward(robot.joint_map().model(readings)), flange(readings)
        assert np.linalg.norm(found[:3, 3] - wanted[:3, 3]) < 1e-6
        np.testing.assert_allclose(found[:3, :3], wanted[:3, :3], rtol=0, atol=1e-9)


@pytest.mark.parametrize("to", ["mdh-hayati", "dh-craig", "poe"])
def test_the_calibration_of_a_real_ur3_is_its_robot_in_every_form(folder, to):
    (folder / "calibration.conf").write_text(UR3_CONF)
    robot = converted("calibration.conf", "ur3", to=to)
    deltas = {
        name: [float(each) for each in body.split(",")]
        for name, body in re.findall(r"delta_(\w+) = \[([^\]]*)\]", UR3_CONF)
    }
    rows = [
        (math.radians(theta) + dt, d + 1000 * dd, a + 1000 * da, math.radians(alpha) + dal)
        for (theta, d, a, alpha), dt, dd, da, dal in zip(
            UR3_ROWS, deltas["theta"], deltas["d"], deltas["a"], deltas["alpha"], strict=True
        )
    ]
    assert max(abs(row[1]) for row in rows) > 29_000.0
    assert_same_flange(robot, lambda readings: flange_by_rows(rows, readings))
    assert robot.calibration is not None
    assert robot.calibration.file == "calibration.conf"
    sizes = [abs(value) for row in robot.links for value in (row.a, row.d)]
    assert max([*sizes, 0.0, *(abs(x) for row in robot.screws for x in row.point)]) < 600.0


def test_rows_of_440_m_are_read_to_a_nanometre(folder):
    sheet = [
        (0, 180.7, 0, 90),
        (0, 0, -612.7, 0),
        (0, 0, -571.55, 0),
        (0, 174.15, 0, 90),
        (0, 119.85, 0, -90),
        (0, 116.55, 0, 0),
    ]
    (folder / "calibration.conf").write_text(conf_of(FACTORY_DH, sheet))
    robot = converted("calibration.conf", "ur10e")
    assert_same_flange(robot, lambda readings: flange_by_rows(FACTORY_DH, readings))


def test_written_as_link_poses_and_read_again_it_is_the_same_robot(folder):
    (folder / "calibration.conf").write_text(UR3_CONF)
    first = converted("calibration.conf", "ur3")
    assert cellctl("convert", "robot.yaml", "--to", "ur-calibration", "-o", "links.yaml") == 0
    assert_same_flange(first, lambda readings: tool0((folder / "links.yaml").read_text(), readings))
    again = converted("links.yaml", "ur3", to="poe")
    chain = first.chain()
    assert_same_flange(again, lambda readings: chain.forward(first.joint_map().model(readings)))
    known = yaml.safe_load((folder / "links.yaml").read_text())["kinematics"]["hash"]
    assert again.calibration is not None
    assert again.calibration.hash == known


def test_the_hash_of_the_controller_is_kept_through_a_robot_file(folder):
    perturbed(library_robot("ur5e"), 1, 1e-3, 0.5).save(folder / "model.json")
    assert cellctl("convert", "model.json", "--to", "ur-calibration", "-o", "links.yaml") == 0
    text = re.sub(r"calib_\d+", "calib_12788084448423163542", (folder / "links.yaml").read_text())
    (folder / "links.yaml").write_text(text)
    robot = converted("links.yaml", "ur5e")
    perturbed(robot, 2, 1e-3, 0.5).save(folder / "fitted.json")
    assert cellctl("convert", "fitted.json", "--to", "ur-calibration", "-o", "fitted.yaml") == 0
    assert "calib_12788084448423163542" in (folder / "fitted.yaml").read_text()


@pytest.mark.parametrize("name", list(XARM))
def test_an_xarms_kinematics_are_its_robot(folder, name):
    rng = np.random.default_rng(5)
    kinematics, poses = {}, []
    for number, (x, y, z, quarter) in enumerate(XARM[name], 1):
        errors = rng.normal(size=6) * [5e-4, 5e-4, 5e-4, 1e-3, 1e-3, 1e-3]
        row = np.array([x, y, z, quarter * math.pi / 2, 0.0, 0.0]) + errors
        poses.append(row)
        kinematics[f"joint{number}"] = dict(zip(("x", "y", "z", "roll", "pitch", "yaw"), row.tolist(), strict=True))
    (folder / "user.yaml").write_text(yaml.safe_dump({"kinematics": kinematics}))
    robot = converted("user.yaml", name)

    def flange(readings):
        here = np.eye(4)
        for (x, y, z, roll, pitch, yaw), reading in zip(poses, readings, strict=True):
            here = here @ slide([1000 * x, 1000 * y, 1000 * z]) @ turn(Z, yaw) @ turn(Y, pitch) @ turn(X, roll)
            here = here @ turn(Z, math.radians(reading))
        return here

    assert_same_flange(robot, flange)


BROKEN = {
    "another robot": (UR3_CONF, "ur10e", "is not of a Universal Robots UR10e"),
    "another maker": (UR3_CONF, "kr5_r1400", "and KUKA KR5 R1400 is none"),
    "not linearised": (
        UR3_CONF.replace("calibration_status = 2", "calibration_status = 1"),
        "ur3",
        "calibration_status 1",
    ),
    "a list is missing": (re.sub(r"delta_d = .*\n", "", UR3_CONF), "ur3", "delta_d is not there"),
    "a list is short": (UR3_CONF.replace("delta_a = [ -0.000243788991999517813,", "delta_a = ["), "ur3", "six numbers"),
}


@pytest.mark.parametrize(("text", "robot", "words"), BROKEN.values(), ids=list(BROKEN))
def test_what_is_not_whole_or_of_another_robot_is_refused(folder, capsys, text, robot, words):
    (folder / "calibration.conf").write_text(text)
    assert cellctl("convert", "calibration.conf", "--robot", robot, "--to", "poe") == 2
    assert words in " ".join(capsys.readouterr().err.split())


POSES = {
    "joint1: {x: 0, y: 0, z: 0, roll: 0, pitch: 0}": "'joint1' is not six numbers",
    "joint1: {x: 0, y: 0, z: 0, roll: 0, pitch: 0, yaw: text}": "'joint1' is not six numbers",
    "shoulder: {x: 0}": "'upper_arm' is missing",
}


@pytest.mark.parametrize(("row", "words"), POSES.items(), ids=list(POSES))
def test_link_poses_that_are_not_whole_are_refused_with_their_line(folder, capsys, row, words):
    rest = "".join(
        f"  joint{number}: {{x: 0, y: 0, z: 0, roll: 0, pitch: 0, yaw: 0}}\n"
        for number in range(2, 7)
        if "joint1" in row
    )
    (folder / "user.yaml").write_text(f"kinematics:\n  {row}\n{rest}")
    assert cellctl("convert", "user.yaml", "--robot", "xarm6", "--to", "poe") == 2
    assert words in " ".join(capsys.readouterr().err.split())


def test_a_calibration_needs_its_robot_and_nothing_else_does(folder, capsys):
    (folder / "calibration.conf").write_text(UR3_CONF)
    assert cellctl("convert", "calibration.conf", "--to", "poe") == 2
    assert "--robot ur10e" in capsys.readouterr().err
    assert cellctl("convert", "ur3", "--robot", "ur3", "--to", "poe") == 2
    assert "is for a maker's calibration" in capsys.readouterr().err


MOC = """MOC:CFG_1.0:6:0::
#
MOTOR_CALIB:

      -name "rob1_1" -com_offset 1.5708 -valid_com_offset -cal_offset 3.1234 \\
      -valid_cal_offset

      -name "rob1_2" -cal_offset 0.5
#
ARM:
      -name "rob1_1" -upper_joint_bound 2.8
"""


def test_abbs_angles_of_motors_are_named_and_not_read(folder, capsys):
    (folder / "MOC.cfg").write_text(MOC)
    assert cellctl("convert", "MOC.cfg", "--robot", "irb120", "--to", "poe") == 2
    said = " ".join(capsys.readouterr().err.split())
    assert "cal_offset (rob1_1 3.1234, rob1_2 0.5) are angles of the motors" in said


@pytest.mark.long
def test_a_fit_says_whose_geometry_nominal_is(folder, capsys):
    (folder / "calibration.conf").write_text(UR3_CONF)
    robot = converted("calibration.conf", "ur3")
    readings = np.random.default_rng(2).uniform(-90.0, 90.0, (40, 6))
    places = np.asarray(perturbed(robot, 3, 3e-4, 0.2).robot_model().chain.forward(np.radians(readings)))[:, :3, 3]
    rows = [",".join(map(repr, row)) for row in np.hstack([readings, places]).tolist()]
    (folder / "data.csv").write_text("\n".join(["A1,A2,A3,A4,A5,A6,X,Y,Z", *rows]))
    for name, words in (("robot.yaml", "maker's calibration (calibration.conf)"), ("ur3", "data sheet")):
        cellctl("fit", name, "data.csv", "--model", "registration", "--json", "fit.json", "--report", "fit.html")
        report = json.loads((folder / "fit.json").read_text())
        assert report["nominal_geometry"] == words
        assert ("not the data sheet" in report["sentence"]) == (name == "robot.yaml")
        assert words.split(" (", maxsplit=1)[0].replace("'", "&#39;") in (folder / "fit.html").read_text()
