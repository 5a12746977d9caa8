"""URDF files of others: read where they are serial and turn, refused in words where they are not."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellctl.files import InputError
from cellctl.formats.urdf import load_urdf
from tests.helpers.own_model import assert_same_pose, forward_of_urdf

ARM = """\
<?xml version="1.0"?>
<robot name="arm">
  <link name="world"/>
  <link name="base_link"><visual><geometry><box size="1 1 1"/></geometry></visual></link>
  <link name="upper"/> <link name="fore"/> <link name="hand"/> <link name="tool0"/> <link name="pen"/>
  <joint name="stand" type="fixed">
    <parent link="world"/><child link="base_link"/><origin xyz="0.5 0 1" rpy="3.141592653589793 0 0.3"/>
  </joint>
  <joint name="turn" type="revolute">
    <parent link="base_link"/><child link="upper"/><origin xyz="0 0 0.4"/><axis xyz="0 0 -2"/>
    <limit lower="-2" upper="2.5" effort="10" velocity="1.5"/>
  </joint>
  <joint name="lift" type="revolute">
    <parent link="upper"/><child link="fore"/><origin xyz="0.1 0.02 0.05" rpy="0.1 -0.2 1.0"/><axis xyz="0.6 0 0.8"/>
    <limit lower="-1" upper="1" effort="10" velocity="1"/>
  </joint>
  <joint name="roll" type="continuous">
    <parent link="fore"/><child link="hand"/><origin rpy="0 1.5707963267948966 0"/><limit effort="1" velocity="2"/>
  </joint>
  <joint name="flange" type="fixed"><parent link="hand"/><child link="tool0"/><origin xyz="0 0 0.09"/></joint>
  <joint name="grip" type="fixed"><parent link="tool0"/><child link="pen"/><origin xyz="0 0.01 .2" rpy="1 0 0"/></joint>
  <transmission name="t"><joint name="turn"/></transmission>
</robot>
"""
BRANCH = """\
  <link name="camera"/>
  <joint name="eye" type="fixed"><parent link="fore"/><child link="camera"/></joint>
</robot>
"""


def load(tmp_path, text, tip=None):
    (tmp_path / "arm.urdf").write_text(text)
    return load_urdf(tmp_path / "arm.urdf", tip)


def errors(tmp_path, text, tip=None):
    with pytest.raises(InputError) as caught:
        load(tmp_path, text, tip)
    return [(problem.line, f"{problem.what} {problem.cure}") for problem in caught.value.problems]


def test_the_tip_is_where_the_files_own_transforms_put_it(tmp_path):
    robot = load(tmp_path, ARM)
    for readings in np.random.default_rng(0).uniform(-1, 1, (5, 3)):
        q = robot.joint_map().model(np.rad2deg(readings))
        assert_same_pose(robot.chain.forward(q), forward_of_urdf(ARM, "pen", readings))
        assert_same_pose(robot.chain.forward_flange(q), forward_of_urdf(ARM, "tool0", readings))
    assert_same_pose(robot.chain.base, forward_of_urdf(ARM, "base_link", []))


def test_limits_come_in_degrees_and_a_continuous_joint_turns_once_either_way(tmp_path):
    turn, lift, roll = load(tmp_path, ARM).joints
    assert (turn.name, turn.min, turn.max) == ("turn", pytest.approx(-114.59156), pytest.approx(143.23945))
    assert lift.max_speed == pytest.approx(57.29578)
    assert (roll.min, roll.max) == (-360.0, 360.0)


def test_a_speed_of_nothing_is_not_known(tmp_path):
    assert load(tmp_path, ARM.replace('velocity="1.5"', 'velocity="0"')).joints[0].max_speed is None
    assert load(tmp_path, ARM.replace(' velocity="1.5"', "")).joints[0].max_speed is None


def test_where_links_branch_the_tip_is_asked_for_and_taken(tmp_path):
    branched = ARM.replace("</robot>\n", BRANCH)
    (line, words), *more = errors(tmp_path, branched)
    assert (line, more) == (2, [])
    assert "--tip: pen, camera" in words
    robot = load(tmp_path, branched, "camera")
    assert len(robot.joints) == 2
    readings = np.array([0.4, -0.3])
    q = robot.joint_map().model(np.rad2deg(readings))
    assert_same_pose(robot.chain.forward(q), forward_of_urdf(branched, "camera", readings))
    assert "'nose'" in errors(tmp_path, branched, "nose")[0][1]


@pytest.mark.parametrize(
    ("old", "new", "line", "words"),
    [
        ('"lift" type="revolute"', '"lift" type="planar"', 13, "'lift' is planar"),
        ('"lift" type="revolute"', '"lift"', 13, "no type"),
        ('<axis xyz="0.6 0 0.8"/>', '<axis xyz="0 0 0"/>', 14, "no direction"),
        ('<axis xyz="0.6 0 0.8"/>', '<axis xyz="0.6 0"/>', 14, "3 numbers"),
        ('xyz="0 0 0.4"', 'xyz="0 0 nan"', 10, "3 numbers"),
        ('lower="-2"', 'lower="two"', 11, "a number"),
        ('<axis xyz="0.6 0 0.8"/>', '<mimic joint="turn"/>', 13, "follows"),
        ('<parent link="upper"/>', "", 13, "<parent"),
        ('<child link="pen"/>', '<child link="upper"/>', 21, "hangs on two joints"),
        ('<robot name="arm">', '<model name="arm">', 0, "<model> of line 2 is not closed before this place"),
        ('<axis xyz="0.6 0 0.8"/>', '<axis xyz="0.6 0 0.8" xyz="1 0 0"/>', 14, "an attribute stands twice"),
        ('<axis xyz="0.6 0 0.8"/>', "<axis & />", 14, "a character that cannot stand here"),
        ('<axis xyz="0.6 0 0.8"/>', "&deg;", 14, "an entity (&…;) that is not defined"),
        ('<robot name="arm">', '<robot name="arm" xmlns:xacro="http://x">', 2, "xacro"),
        ('<?xml version="1.0"?>', '<!DOCTYPE robot [<!ENTITY a "aaaa">]>', 1, "DOCTYPE"),
        ('<?xml version="1.0"?>', '<?xml version="1.0" encoding="klingon"?>', 1, "an encoding that is not known"),
    ],
)
def test_what_cannot_be_calibrated_is_refused_where_it_stands(tmp_path, old, new, line, words):
    assert old in ARM
    found = errors(tmp_path, ARM.replace(old, new, 1))
    assert words in found[0][1]
    assert line in (0, found[0][0])


@given(st.data())
def test_a_damaged_file_is_read_or_refused_and_nothing_else(tmp_path_factory, data):
    start = data.draw(st.integers(0, len(ARM) - 1))
    end = data.draw(st.integers(start, min(len(ARM), start + 40)))
    new = data.draw(
        st.sampled_from(["", ARM[start:end] * 2, "nan", "1e300", "1e-320", "-", '"', "<", "/>", "é", "&a;"])
    )
    try:
        chain = load(tmp_path_factory.getbasetemp(), ARM[:start] + new + ARM[end:]).chain
    except InputError:
        return
    assert np.isfinite(chain.forward(np.zeros(chain.n))).all()


def test_an_entity_bomb_is_refused_before_it_grows(tmp_path):
    bomb = '<!DOCTYPE robot [<!ENTITY a "ha">' + "".join(
        f'<!ENTITY {chr(98 + i)} "{f"&{chr(97 + i)};" * 10}">' for i in range(20)
    )
    assert "DOCTYPE" in errors(tmp_path, f"{bomb}]><robot>&u;</robot>")[0][1]


def test_several_errors_come_at_once(tmp_path):
    text = ARM.replace('xyz="0 0 0.4"', 'xyz="a"').replace('xyz="0.6 0 0.8"', 'xyz="b"')
    assert [line for line, _ in errors(tmp_path, text)] == [10, 14]


@pytest.mark.parametrize("text", ["", "<robot/>", "<sdf/>", "name: yaml\n", "<robot><link name='a'/></robot>"])
def test_a_file_that_is_no_robot_is_refused(tmp_path, text):
    assert errors(tmp_path, text)


def test_joints_in_a_circle_are_refused(tmp_path):
    ring = "".join(
        f'<joint name="{a}" type="revolute"><parent link="{a}"/><child link="{b}"/></joint>' for a, b in ["ab", "ba"]
    )
    assert "circle" in errors(tmp_path, f"<robot>{ring}</robot>")[0][1]
    assert "circle" in errors(tmp_path, f"<robot>{ring}</robot>", "a")[0][1]


def test_a_file_that_is_not_there_is_reported(tmp_path):
    with pytest.raises(InputError, match="cannot be read"):
        load_urdf(tmp_path / "none.urdf")
