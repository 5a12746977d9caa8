"""`calibration.yaml` of the UR description package: the model's TCP, and numbers of the robot's size."""

import math
from dataclasses import replace

import numpy as np
import pytest
import yaml

from cellctl.cli import exit_codes
from cellctl.cli.verbs import app
from cellctl.files import InputError
from cellctl.formats.description import RobotDescription
from cellctl.formats.exports import hash_of, ur_calibration
from cellctl.kinematics import Link, SerialChain
from tests.helpers.arms import by_axes, library_robot, perturbed
from tests.helpers.own_model import X, Z, assert_same_pose, slide, turn
from tests.helpers.ur import FACTORY_DH, LINKS, tool0

URS = ["ur3", "ur3e", "ur5", "ur5e", "ur10", "ur10e", "ur16e"]


def exported(model, known=None):
    nominal = RobotDescription.of(model.robot)
    return ur_calibration(nominal, RobotDescription.of(model.robot, model.robot_model().chain), "model.json", known)


@pytest.mark.parametrize("name", URS)
@pytest.mark.parametrize("tilt", [1e-6, 1e-4, 1e-2])
def test_almost_parallel_axes_keep_every_number_near_the_makers_and_the_tcp_exact(name, tilt):
    robot = library_robot(name)
    model = perturbed(robot, 3, tilt, 0.5)
    made, usual = exported(model), exported(perturbed(robot, 0, 0.0, 0.0))
    links, makers = (yaml.safe_load(each.text)["kinematics"] for each in (made, usual))
    reach_m = robot.chain().reach_mm / 1000.0
    for link in LINKS:
        for key in "xyz":
            assert abs(links[link][key] - makers[link][key]) < 0.003 + 4.0 * tilt * reach_m
    for readings in np.random.default_rng(1).uniform(-180.0, 180.0, (20, 6)):
        pose = model.robot_model().pose(robot.joint_map().model(readings))
        assert_same_pose(made.base @ tool0(made.text, readings) @ made.tcp, pose)


def test_a_factory_calibration_with_links_of_440_m_becomes_a_robot_of_its_size():
    usual = RobotDescription.of(library_robot("ur10e"))
    chain = SerialChain.from_links("mdh-hayati", [Link(theta, d, a, alpha) for theta, d, a, alpha in FACTORY_DH])
    made = ur_calibration(usual, replace(usual, chain=chain), "ur10e", None)
    links = yaml.safe_load(made.text)["kinematics"]
    assert max(abs(links[link][key]) for link in LINKS for key in "xyz") < 0.62
    for readings in np.random.default_rng(4).uniform(-180.0, 180.0, (10, 6)):
        here = np.eye(4)
        for (theta, d, a, alpha), reading in zip(FACTORY_DH, readings, strict=True):
            here = here @ turn(Z, theta + math.radians(reading)) @ slide([a, 0, d]) @ turn(X, alpha)
        found = tool0(made.text, readings) @ made.tcp
        np.testing.assert_allclose(found[:3, 3], here[:3, 3], rtol=0, atol=1e-6)
        np.testing.assert_allclose(found[:3, :3], here[:3, :3], rtol=0, atol=1e-9)
    np.testing.assert_allclose(made.tcp, np.eye(4), atol=1e-6)  # `tool0` is the flange, as the controller has it


def test_a_model_by_axes_gives_the_same_robot_as_one_by_links():
    robot = by_axes(library_robot("ur5e"))
    model = perturbed(robot, 5, 2e-3, 0.7)
    made = exported(model)
    for readings in np.random.default_rng(2).uniform(-180.0, 180.0, (5, 6)):
        pose = model.robot_model().pose(robot.joint_map().model(readings))
        assert_same_pose(made.base @ tool0(made.text, readings) @ made.tcp, pose)


def test_the_nominal_robot_has_the_numbers_of_the_description_package():
    """The maker's lengths of the UR10, in the places and with the rolls of the package's default_kinematics.yaml."""
    links = yaml.safe_load(exported(perturbed(library_robot("ur10"), 0, 0.0, 0.0)).text)["kinematics"]
    wanted = {
        "shoulder": (0, 0, 0.1273, 0),
        "upper_arm": (0, 0, 0, math.pi / 2),
        "forearm": (-0.612, 0, 0, 0),
        "wrist_1": (-0.5723, 0, 0.163941, 0),
        "wrist_2": (0, -0.1157, 0, math.pi / 2),
        "wrist_3": (0, 0.0922, 0, -math.pi / 2),
    }
    for name, (x, y, z, roll) in wanted.items():
        row = [links[name][key] for key in ("x", "y", "z", "roll", "pitch", "yaw")]
        np.testing.assert_allclose(row, [x, y, z, roll, 0, 0], atol=1e-12)


@pytest.mark.parametrize(
    ("name", "words"), [("iiwa14", "7 joints"), ("kr5_r1400", "against"), ("tx60", "shoulder|upper_arm|forearm|wrist")]
)
def test_another_makers_robot_is_refused(name, words):
    with pytest.raises(InputError, match=f"is no UR robot: .*({words})"):
        exported(perturbed(library_robot(name), 0, 0.0, 0.0))


def test_a_robot_file_in_the_frame_base_link_is_refused():
    """It is turned by half a turn against the controller's base; the whole robot would point backwards."""
    robot = by_axes(library_robot("ur10"))
    screws = [
        {"axis": [-s.axis[0], -s.axis[1], s.axis[2]], "point": [-s.point[0], -s.point[1], s.point[2]]}
        for s in robot.screws
    ]
    turned = robot.model_copy(update={"screws": [type(robot.screws[0])(**each) for each in screws]})
    with pytest.raises(InputError, match=r"(shoulder|upper_arm) is turned"):
        exported(perturbed(turned, 0, 0.0, 0.0))


def test_the_controllers_hash_is_kept_and_a_file_without_one_is_refused(tmp_path):
    (tmp_path / "mine.yaml").write_text("kinematics:\n  shoulder: {x: 0}\n  hash: calib_12788084448423163542\n")
    known = hash_of(tmp_path / "mine.yaml")
    assert (
        "  hash: calib_12788084448423163542\n" in exported(perturbed(library_robot("ur10"), 1, 1e-3, 0.3), known).text
    )
    (tmp_path / "none.yaml").write_text("kinematics: {}\n")
    with pytest.raises(InputError, match="hash"):
        hash_of(tmp_path / "none.yaml")


def test_two_calibrations_have_two_hashes():
    texts = {exported(perturbed(library_robot("ur10"), seed, 1e-3, 0.3)).text.splitlines()[-1] for seed in (1, 2)}
    assert len(texts) == 2


def test_the_command_says_that_base_tool_and_the_controllers_hash_are_not_in_it(tmp_path, capsys):
    perturbed(library_robot("ur10"), 1, 1e-3, 0.3).save(tmp_path / "m.json")
    words = ["convert", str(tmp_path / "m.json"), "--to", "ur-calibration", "-o", str(tmp_path / "c.yaml")]
    assert exit_codes.exit_code_of(lambda: app(words, standalone_mode=False)) == 0
    said = capsys.readouterr().err
    assert "the TCP in tool0 is X, Y, Z" in said
    assert "hash" in said
    assert yaml.safe_load((tmp_path / "c.yaml").read_text())["kinematics"]["hash"].startswith("calib_")
