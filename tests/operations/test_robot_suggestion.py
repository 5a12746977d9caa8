"""Which robot of the library rows are of: positions of the tests' own UR10, its base and reflector not known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cellctl.formats import DataSet
from cellctl.operations.robot_suggestion import doubt_of, nearer_robots, suggest_robots
from tests.helpers.arms import library_robot
from tests.helpers.own_model import pose_of, ur10
from tests.helpers.simulated_setups import UR10_REGION

READINGS = np.degrees(np.random.default_rng(4).uniform(*UR10_REGION, (60, 6)))
IRB120_LIMITS = np.array([[-165, 165], [-110, 110], [-110, 70], [-160, 160], [-120, 120], [-400, 400]])
"""Of its data sheet, deg."""


def rows() -> DataSet:
    """60 positions without noise."""
    base = pose_of(Rotation.from_euler("ZYX", [0.4, -0.2, 0.1]), [700.0, -400.0, 300.0])
    arm = replace(ur10(), base=base, tool=pose_of(Rotation.identity(), [30.0, -20.0, 90.0]))
    places = arm.points(np.radians(READINGS))
    names = [*(f"A{axis}" for axis in range(1, 7)), "X", "Y", "Z"]
    return DataSet.of_records([dict(zip(names, row, strict=True)) for row in np.hstack([READINGS, places]).tolist()])


def test_the_robot_that_was_measured_comes_first_and_the_share_outside_the_limits_of_others_is_known() -> None:
    found = suggest_robots(rows())
    best = found.robots[0]
    assert (best.name, best.outside, best.plausible, found.certainty) == ("ur10", 0.0, True, "clear")
    assert best.rms_mm is not None
    assert best.rms_mm < 1e-3, "its links are those of the library, base and tool are fitted"
    others = [each.rms_mm for each in found.robots[1:] if each.rms_mm is not None]
    assert found.sentence.endswith(f"; the next robot {min(others):.3g} mm.")
    [irb] = (each for each in found.robots if each.name == "irb120")
    beyond = np.maximum(IRB120_LIMITS[:, 0] - READINGS, READINGS - IRB120_LIMITS[:, 1]).max(axis=1)
    assert irb.outside == pytest.approx(np.mean(beyond > 5.0)), "5° beyond a limit are still taken for its end"
    assert 0.1 < irb.outside < 0.9


def test_a_wrong_robot_file_is_doubted_and_the_right_robot_is_named_in_its_place() -> None:
    data, wrong = rows(), library_robot("ur5")
    assert doubt_of(library_robot("ur10"), data) == ""
    assert doubt_of(wrong, data).startswith("Is this the robot that was measured? With base and tool fitted, the ")
    assert nearer_robots(library_robot("ur10"), data) is None
    nearer = nearer_robots(wrong, data)
    assert nearer is not None
    assert nearer.robots[0].name == "ur10"
