"""The robots' flanges are where an independent second source has them, to the agreement that their files state.

`second_sources.yaml` holds the link tables of the second sources, as their packages have them.
"""

from pathlib import Path

import numpy as np
import pytest
import yaml

from cellctl.formats import RobotFile
from cellctl.installed import shipped
from cellctl.robot_file import SecondSource

SECOND = yaml.safe_load((Path(__file__).parent / "second_sources.yaml").read_text(encoding="utf-8"))
CHECKED = sorted(
    name for name, file in shipped("robot").items() if isinstance(RobotFile.load(file).source.checked, SecondSource)
)


def turn(axis, angle):
    c, s = np.cos(angle), np.sin(angle)
    about = {"x": [[1, 0, 0], [0, c, -s], [0, s, c]], "z": [[c, -s, 0], [s, c, 0], [0, 0, 1]]}
    pose = np.eye(4)
    pose[:3, :3] = about[axis]
    return pose


def shift(x, z):
    pose = np.eye(4)
    pose[[0, 2], 3] = x, z
    return pose


def flange(second, readings):
    """The second source's flange: T = Rx(alpha) Tx(a) Rz(theta) Tz(d) for each joint. Plain matrices."""
    pose = shift(0, second["up"])
    for (alpha, a, d, theta), sign, reading in zip(second["rows"], second["signs"], readings, strict=True):
        angle = np.radians(theta + sign * reading)
        pose = pose @ turn("x", np.radians(alpha)) @ shift(a, 0) @ turn("z", angle) @ shift(0, d)
    return pose


def test_every_checked_robot_has_its_second_source_here_and_at_least_fifteen_are_checked():
    assert sorted(SECOND) == CHECKED
    assert len(CHECKED) >= 15


@pytest.mark.parametrize("name", CHECKED)
def test_the_flange_is_where_the_second_source_has_it(name):
    robot, second = RobotFile.load(shipped("robot")[name]), SECOND[name]
    stated = robot.source.checked
    readings = np.random.default_rng(1).uniform(-100.0, 100.0, (200, robot.n))
    ours = robot.chain().with_tool(np.eye(4)).forward_flange(robot.joint_map().model(readings))
    theirs = np.array([flange(second, row) for row in readings])
    worst = np.linalg.norm(ours[:, :3, 3] - theirs[:, :3, 3], axis=1).max()
    assert stated.against == second["source"]
    assert worst == pytest.approx(stated.agreement_mm, abs=max(0.002, 0.05 * worst))
    between = ours[:, :3, :3].transpose(0, 2, 1) @ theirs[:, :3, :3]
    np.testing.assert_allclose(between, np.broadcast_to(between[0], between.shape), atol=1e-4)  # a fixed flange turn
