"""Positions of a real UR10 (ipa-robot-accuracy data set), as a file for the race with pybotics."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from cellctl.calibration import PositionRows, RobotModel, Task
from cellctl.calibration.estimation.identify import registered
from cellctl.kinematics import Link, SerialChain

DATA = Path(__file__).parents[3] / "shared" / "data" / "ur10_tracker" / "measurements_grid.csv"
JOINTS = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
RIGHT = np.pi / 2
LINKS = np.array(
    [
        [0.0, 0.0, 0.0, 127.3],
        [RIGHT, 0.0, 0.0, 0.0],
        [0.0, -612.0, 0.0, 0.0],
        [0.0, -572.3, 0.0, 163.941],
        [RIGHT, 0.0, 0.0, 115.7],
        [-RIGHT, 0.0, 0.0, 92.2],
    ]
)
"""alpha, a, theta, d of each link, after Craig."""

REPEATABILITY_MM = 0.037
FRESH = 300


def save_real_rows(path: Path, count: int) -> Path:
    """`count` measured positions and FRESH others, base and tool registered on the former: see `serving.Rows`."""
    with DATA.open(newline="") as source:
        rows = list(csv.DictReader(source, delimiter=";"))
    chosen = np.random.default_rng(5).permutation(len(rows))[: count + FRESH]
    names = [*(f"{joint}_joint" for joint in JOINTS), *(f"measurement_{axis}" for axis in "xyz")]
    numbers = np.array([[float(rows[row][name].replace(",", ".")) for name in names] for row in chosen])
    q, xyz = numbers[:, :6], numbers[:, 6:]
    sigma = REPEATABILITY_MM / np.sqrt(3.0)
    links = [Link(theta=theta, d=d, a=a, alpha=alpha) for alpha, a, theta, d in LINKS]
    chain = SerialChain.from_links("dh-craig", links, np.eye(4), np.eye(4))
    task = Task(RobotModel(chain), PositionRows(q[:count], xyz[:count], np.full((count, 3), sigma)))
    there = registered(task, task.rows).state.model.chain
    base = np.concatenate([there.base_now[:3, 3], Rotation.from_matrix(there.base_now[:3, :3]).as_euler("ZYX")])
    tool = np.concatenate([there.tool_now[:3, 3], np.zeros(3)])
    held_out = {"held_out_q": q[count:], "held_out_xyz": xyz[count:]}
    np.savez(path, links=LINKS, sigma=sigma, base=base, tool=tool, q=q[:count], xyz=xyz[:count], **held_out)
    return path
