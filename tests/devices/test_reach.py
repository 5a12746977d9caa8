"""The reach that speeds are limited by is never less than how far a robot's TCP gets from its first axis."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cellctl.devices.cell import reach_of
from cellctl.formats import RobotFile

ROBOTS = Path(__file__).parents[2] / "procedures" / "robots"

POE = """
name: two axes
convention: poe
screws:
  - {axis: [0, 0, 1], point: [0, 0, 0]}
  - {axis: [0, 1, 0], point: [0, 0, 300]}
home: {xyz: [400, 0, 300]}
joints:
  - {min: -180, max: 180, max_speed: 100}
  - {min: -180, max: 180, max_speed: 100}
tool: {xyz: [0, 0, 100]}
repeatability: 0.03
"""


def farthest(robot: RobotFile, postures: int = 2000) -> float:
    """The largest distance of the TCP from the base's z axis over random joint readings, mm."""
    low, high = robot.limits().T
    readings = np.random.default_rng(1).uniform(low, high, (postures, len(low)))
    poses = robot.chain().forward(robot.joint_map().model(readings))
    return float(np.hypot(poses[:, 0, 3], poses[:, 1, 3]).max())


@pytest.mark.parametrize("file", sorted(ROBOTS.glob("*.yaml")), ids=lambda file: file.stem)
def test_no_posture_of_a_shipped_robot_is_beyond_its_reach(file: Path) -> None:
    reach, true = reach_of(file), farthest(RobotFile.load(file))
    assert reach is not None
    assert true <= reach <= 2.0 * true  # beyond that, speeds would be limited to less than half without need


def test_the_reach_of_a_robot_given_by_axes_is_the_way_along_them(tmp_path: Path) -> None:
    (tmp_path / "robot.yaml").write_text(POE)
    RobotFile.load(tmp_path / "robot.yaml")
    assert reach_of(tmp_path / "robot.yaml") == pytest.approx(300 + 400 + 100)


@pytest.mark.parametrize("text", [None, "- 1\n", "links: 7\n", "links: [{a: x}]\n", "a: {\n", "name: empty\n"])
def test_a_file_without_lengths_has_no_known_reach(tmp_path: Path, text: str | None) -> None:
    if text is not None:
        (tmp_path / "robot.yaml").write_text(text)
    assert reach_of(tmp_path / "robot.yaml") is None
