"""Calibrated joint origins in the user's own URDF: everything else keeps its bytes, and links stay on their meshes."""

import re

import numpy as np
import pytest

from cellctl.cli import exit_codes
from cellctl.cli.verbs import app
from cellctl.files import InputError
from cellctl.formats.description import RobotDescription
from cellctl.formats.exports import urdf_into
from cellctl.kinematics import inverse_pose
from tests.helpers.arms import library_robot, perturbed
from tests.helpers.own_model import assert_same_pose, forward_of_urdf, slide, turn

KR5 = """\
<?xml version="1.0" encoding="iso-8859-1"?>
<!-- Zelle f\u00fcr Pr\u00fcfung: <origin xyz="9 9 9"/> -->\r
<robot name="cell">
  <material name="orange"><color rgba="1 0.5 0 1"/></material>
  <link name="world"/>
  <link name="base_link"><visual><origin xyz="0 0 0.1"/><geometry><mesh filename="base.stl"/></geometry></visual></link>
  <link name="link_1">
    <inertial>
      <origin xyz="0.1 0 0"/><mass value="30"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>
    </inertial>
  </link>
  <link name="link_2"/> <link name="link_3"/> <link name="link_4"/> <link name="link_5"/> <link name="link_6"/>
  <link name="flange"/> <link name="tool0"/> <link name="camera"/>
  <joint name="stand" type="fixed">
    <parent link="world"/><child link="base_link"/><origin xyz="0.5 -0.2 0.8" rpy="0 0 0.3"/>
  </joint>
  <joint name="joint_a1" type="revolute">
    <origin rpy="0 0 0" xyz="0 0 0.4" /><parent link="base_link"/><child link="link_1"/><axis xyz="0 0 -1"/>
    <limit lower="-2.7" upper="2.7" effort="0" velocity="2.6"/>
  </joint>
  <joint name="joint_a2" type="revolute">
    <origin
      xyz='0.18 0.1 0'
    ></origin><parent link="link_1"/><child link="link_2"/><axis xyz="0 2 0"/>
    <limit lower="-3.1" upper="1.1" effort="0" velocity="2.6"/>
  </joint>
  <joint name="joint_a3" type="revolute">
    <origin xyz="0.6 -0.1 0"/><parent link="link_2"/><child link="link_3"/><axis xyz="0 1 0"/>
    <limit lower="-1.9" upper="2.9" effort="0" velocity="3.9"/>
  </joint>
  <joint name="joint_a4" type="revolute">
    <origin xyz="0 0 0.04"/><parent link="link_3"/><child link="link_4"/><axis xyz="-1 0 0"/>
    <limit lower="-6.1" upper="6.1" effort="0" velocity="5.9"/>
  </joint>
  <joint name="joint_a5" type="revolute">
    <origin xyz="0.62 0 0"/><parent link="link_4"/><child link="link_5"/><axis xyz="0 1 0"/>
    <limit lower="-2.2" upper="2.2" effort="0" velocity="6.7"/>
  </joint>
  <joint name="joint_a6" type="revolute">
    <parent link="link_5"/><child link="link_6"/><axis xyz="-1 0 0"/>
    <limit lower="-6.1" upper="6.1" effort="0" velocity="12.5"/>
  </joint>
  <joint name="eye" type="fixed"><origin xyz="0 0 0.1"/><parent link="link_3"/><child link="camera"/></joint>
  <joint name="joint_flange" type="fixed"><origin xyz="0.08 0 0"/><parent link="link_6"/><child link="flange"/></joint>
  <joint name="flange_tool0" type="fixed">
    <origin rpy="0 1.5707963267948966 0"/><parent link="flange"/><child link="tool0"/>
  </joint>
</robot>
"""
ORIGIN_OF_JOINT = re.compile(rb"(<joint [^>]*>(?:(?!</joint>).)*?)\s*<origin[^>]*?(/?)>", re.DOTALL)


@pytest.fixture
def file(tmp_path):
    (tmp_path / "cell.urdf").write_bytes(KR5.encode("latin-1"))
    return tmp_path / "cell.urdf"


def described(model):
    return RobotDescription.of(model.robot), RobotDescription.of(model.robot, model.robot_model().chain)


def written(model, file, tip="tool0"):
    return urdf_into(file, *described(model), tip)


def flange(model, readings):
    """The identified flange in the robot's base frame (4, 4), mm."""
    chain = model.robot_model().chain
    return inverse_pose(chain.base_now) @ chain.forward_flange(model.robot.joint_map().model(readings))


@pytest.fixture(params=[0.0, 1e-6, 1e-3])
def model(request):
    return perturbed(library_robot("kr5_r1400"), 4, request.param, 0.6)


ROOT = slide([500, -200, 800]) @ turn([0, 0, 1], 0.3)
"""The robot's base in `world`."""


def test_the_flange_is_where_the_model_has_it_at_any_readings(model, file):
    content, lacking = written(model, file)
    assert lacking is None
    for readings in np.random.default_rng(0).uniform(-90, 90, (10, 6)):
        there = forward_of_urdf(content, "tool0", np.radians(readings))
        turned = inverse_pose(ROOT @ flange(model, np.zeros(6))) @ forward_of_urdf(content, "tool0", np.zeros(6))
        assert np.linalg.norm(turned[:3, 3]) < 1e-9  # `tool0` has another x than the flange of the robot file
        assert_same_pose(there, ROOT @ flange(model, readings) @ turned)


def test_a_model_without_deviations_changes_no_byte(file):
    assert written(perturbed(library_robot("kr5_r1400"), 0, 0.0, 0.0), file)[0] == KR5.encode("latin-1")


def test_everything_but_origins_of_joints_keeps_its_bytes(file):
    content, _ = written(perturbed(library_robot("kr5_r1400"), 4, 1e-3, 0.6), file)
    before, after = (ORIGIN_OF_JOINT.sub(rb"\1<\2>", each) for each in (KR5.encode("latin-1"), content))
    added = re.sub(rb'(<joint name="joint_a6" type="revolute">)<[^>]*>', rb"\1", after)
    assert added == before
    assert content.count(b"<origin") == KR5.count("<origin") + 1  # joint_a6 had none


def test_links_stay_on_their_meshes(file):
    """A link frame moves by its axis' own deviation, not along the axis and not about it."""
    model = perturbed(library_robot("kr5_r1400"), 4, 1e-3, 0.6)
    content, _ = written(model, file)
    for link in ("link_1", "link_2", "link_3", "link_4", "link_5", "link_6"):
        old, new = (forward_of_urdf(text, link, [0.0] * int(link[-1])) for text in (KR5.encode("latin-1"), content))
        assert np.linalg.norm((new - old)[:3, 3]) < 5.0
        assert np.linalg.norm((new - old)[:3, :3]) < 0.02


def test_links_at_arbitrary_places_along_their_axes_stay_there(file):
    """joint_a2 is 100 mm aside on its own axis: a DH table would have moved it."""
    content, _ = written(perturbed(library_robot("kr5_r1400"), 4, 1e-4, 0.2), file)
    old, new = (forward_of_urdf(text, "link_2", [0.0, 0.0]) for text in (KR5.encode("latin-1"), content))
    assert np.linalg.norm((new - old)[:3, 3]) < 1.0


def test_without_a_joint_behind_the_last_one_what_the_tip_lacks_is_said(file):
    content, lacking = written(perturbed(library_robot("kr5_r1400"), 4, 1e-3, 0.6), file, "link_6")
    assert re.fullmatch(r"\d\.\d{3} mm and \d\.\d{4}° at link 'link_6': .*", lacking)
    assert content.count(b"joint_flange") == 1


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (
            '<axis xyz="-1 0 0"/>\n    <limit lower="-6.1" upper="6.1" effort="0" velocity="5.9"',
            '<axis xyz="1 0 0"/>\n    <limit lower="-6.1" upper="6.1" effort="0" velocity="5.9"',
            "joint_a4",
        ),
        ('xyz="0.6 -0.1 0"', 'xyz="0.62 -0.1 0"', "joint_a3"),
        ('name="joint_a6" type="revolute"', 'name="joint_a6" type="fixed"', "5 turning joints"),
        ('name="joint_a6" type="revolute"', 'name="joint_a6" type="prismatic"', "'joint_a6' is prismatic"),
    ],
)
def test_the_urdf_of_another_robot_is_refused_and_the_joint_is_named(old, new, words, file):
    text = KR5.replace(old, new)
    assert text != KR5
    file.write_bytes(text.encode("latin-1"))
    with pytest.raises(InputError, match=words):
        written(perturbed(library_robot("kr5_r1400"), 4, 1e-3, 0.6), file)


def test_the_last_link_is_asked_for_where_links_branch(file):
    with pytest.raises(InputError, match=r"--tip: .*tool0"):
        written(perturbed(library_robot("kr5_r1400"), 4, 1e-3, 0.6), file, None)


def test_the_command_writes_it_and_never_over_the_users_file(file, tmp_path, capsys):
    perturbed(library_robot("kr5_r1400"), 4, 1e-3, 0.6).save(tmp_path / "m.json")
    words = ["convert", str(tmp_path / "m.json"), "--to", "urdf", "--into", str(file), "--tip", "tool0", "-o"]
    assert exit_codes.exit_code_of(lambda: app([*words, str(tmp_path / "new.urdf")], standalone_mode=False)) == 0
    assert "base and tool of the fit are not in the URDF" in capsys.readouterr().err
    assert (tmp_path / "new.urdf").read_bytes() != KR5.encode("latin-1")
    assert exit_codes.exit_code_of(lambda: app([*words, str(file)], standalone_mode=False)) == 2
    assert file.read_bytes() == KR5.encode("latin-1")


def test_into_needs_a_model(file, tmp_path, capsys):
    words = ["convert", "kr5_r1400", "--to", "urdf", "--into", str(file)]
    assert exit_codes.exit_code_of(lambda: app(words, standalone_mode=False)) == 2
    assert "--into is for a model" in capsys.readouterr().err
