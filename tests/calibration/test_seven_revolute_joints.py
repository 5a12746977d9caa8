"""A seventh revolute joint, before the six of an arm (a turntable) or behind them: found from made positions.

The truth has the arm's six joints from `SerialChain` alone; the seventh turns by its own formula, with errors of its
axis and zero.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cellctl.calibration import Split, fit
from cellctl.formats import DataSet, measurements
from cellctl.formats.description import in_poe
from cellctl.kinematics import Floats
from cellctl.robot_file import RobotFile
from tests.helpers.arms import KR5_FILE
from tests.helpers.sliding_robots import FLOOR_MM, HIGH, LOW, NOISE_MM, sliding_robot_text

FIT, TEST = 110, 40
ARM = in_poe(RobotFile.load(KR5_FILE))
HOME = ARM.chain().forward_flange(np.zeros((1, 6)))[0]
AXES = {
    "first": (np.array([0.0, 0.0, 1.0]), np.array([-600.0, 0.0, 0.0])),
    "last": (np.array([1.0, 0.0, 0.0]), HOME[:3, 3] + [0.0, 40.0, 0.0]),
}
"""Direction and a point, mm, in the base frame at home."""

JOINT = "{sign: -1, offset: 20, min: -170, max: 170, max_speed: 90}"


def robot_of(folder: Path, end: str) -> RobotFile:
    """The robot file: that of a robot with a slide at this end, whose joint and axis are exchanged."""
    text = sliding_robot_text("rail" if end == "first" else "quill")
    direction, point = (each.tolist() for each in AXES[end])
    lines = text.splitlines()
    (joint,) = (number for number, line in enumerate(lines) if "prismatic" in line)
    lines[joint] = f"  - {JOINT}"
    screws = [number for number, line in enumerate(lines) if line.startswith("  - {axis:")]
    lines[screws[0 if end == "first" else -1]] = f"  - {{axis: {direction}, point: {point}}}"
    (folder / "robot.yaml").write_text("\n".join(lines) + "\n")
    return RobotFile.load(folder / "robot.yaml")


def turned(end: str, readings: Floats) -> Floats:
    """Poses (N, 4, 4) by which the seventh joint carries what is behind it; its axis and zero are off."""
    direction, point = AXES[end]
    direction = direction + np.roll(direction, 1) * 1e-3
    angles = np.deg2rad(-readings + 20.0 + 0.04)
    found = np.tile(np.eye(4), (len(readings), 1, 1))
    found[:, :3, :3] = Rotation.from_rotvec(angles[:, None] * direction / np.linalg.norm(direction)).as_matrix()
    found[:, :3, 3] = (point + 0.4) - found[:, :3, :3] @ (point + 0.4)
    return found


def true_tcps(end: str, readings: Floats) -> Floats:
    """True TCP (N, 3), mm, in the frame of an instrument."""
    arm, seventh = (readings[:, 1:], readings[:, 0]) if end == "first" else (readings[:, :6], readings[:, 6])
    chain = ARM.chain()
    sizes = np.where(chain.parameter_turns, np.deg2rad(0.04), 0.3)
    sizes[[name.startswith(("base", "tool")) for name in chain.parameters]] = 0.0
    flange = chain.with_parameters(sizes * np.random.default_rng(5).normal(size=sizes.size)).forward_flange(
        ARM.joint_map().model(arm)
    )
    carried = turned(end, seventh)
    flange = carried @ flange if end == "first" else flange @ np.linalg.inv(HOME) @ carried @ HOME
    tcp = (flange @ chain.tool)[:, :3, 3]
    station = Rotation.from_euler("zyx", [35.0, 1.0, -0.5], degrees=True)
    return np.asarray(station.apply(tcp) + np.array([4200.0, -900.0, 650.0]))


@pytest.mark.long
@pytest.mark.parametrize("end", ["first", "last"])
def test_it_is_found_to_its_noise_at_either_end(end: str, tmp_path: Path) -> None:
    robot, rng = robot_of(tmp_path, end), np.random.default_rng(6)
    seventh, arm = rng.uniform(-160.0, 160.0, (FIT + TEST, 1)), rng.uniform(LOW, HIGH, (FIT + TEST, 6))
    readings = np.hstack([seventh, arm] if end == "first" else [arm, seventh])
    measured = true_tcps(end, readings) + rng.normal(0.0, NOISE_MM, (FIT + TEST, 3))
    records = [
        {**{f"A{axis}": value for axis, value in enumerate(row, 1)}, **dict(zip("XYZ", place, strict=True))}
        for row, place in zip(readings.tolist(), measured.tolist(), strict=True)
    ]
    task = measurements(robot, DataSet.of_records(records, "rows.csv"), model="geometry").task
    found = fit(task, Split.by_column(np.arange(FIT + TEST) >= FIT))
    assert found.nominal.mean > 0.5
    assert found.test.mean < 1.35 * FLOOR_MM
