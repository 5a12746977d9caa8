"""How good an identified robot is all over its workspace, against the simulated world's truth: for tests and studies.

The workspace: tool tip in a box of 700 × 1000 × 650 mm before the robot, shaft within 60° of straight down, any spin.
"""

from __future__ import annotations

import csv
import subprocess
import sys
from pathlib import Path

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation
from scipy.stats import qmc

from cellctl.formats import ModelFile, RobotFile
from cellctl.kinematics import Floats, inverse

LOW, HIGH = np.array([650.0, -500.0, 50.0]), np.array([1350.0, 500.0, 700.0])


def workspace(model: ModelFile, count: int) -> Floats:
    """Joint readings (count, 6), deg, quasi-random over the workspace, within the joint limits."""
    return workspace_of(model.robot, count)


def workspace_of(robot: RobotFile, count: int) -> Floats:
    """The same for the nominal robot of a robot file."""
    chain, joints, limits = robot.chain(), robot.joint_map(), robot.limits()
    samples = qmc.Sobol(6, seed=7).random(4 * count)
    tips = LOW + samples[:, :3] * (HIGH - LOW)
    tilt, around, spin = samples[:, 3] * np.radians(60.0), samples[:, 4] * 2 * np.pi, samples[:, 5] * 2 * np.pi
    turned = Rotation.from_euler("ZYZ", np.stack([around, tilt, -around + spin], axis=1))
    down = turned * Rotation.from_euler("x", np.pi)
    poses = np.tile(np.eye(4), (len(tips), 1, 1))
    poses[:, :3, :3], poses[:, :3, 3] = down.as_matrix(), tips
    heading = np.degrees(np.arctan2(-tips[:, 1], tips[:, 0]))
    start = np.tile([0.0, -60.0, 90.0, 0.0, 60.0, 0.0], (len(tips), 1))
    start[:, 0] = heading
    found = inverse(chain, poses, joints.model(start))
    readings = (joints.readings(found.q) + 180.0) % 360.0 - 180.0
    good = found.converged & (readings > limits[:, 0]).all(axis=1) & (readings < limits[:, 1]).all(axis=1)
    assert good.sum() >= count, "the workspace lies outside the robot's reach"
    return readings[good][:count]


def truth(cell: Path, seed: int, readings: Floats, folder: Path) -> Floats:
    """The simulated robot's true mean tool centre points (N, 3), mm, through `python -m sims truth`."""
    joints, points = folder / "joints.csv", folder / "truth.csv"
    with joints.open("w", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow([f"A{axis}" for axis in range(1, 7)])
        writer.writerows(readings.tolist())
    command = [sys.executable, "-m", "sims", "truth", str(cell), str(joints), "--seed", str(seed), "-o", str(points)]
    subprocess.run(command, check=True, timeout=600)
    return np.loadtxt(points, delimiter=",", skiprows=1, usecols=(0, 1, 2))


def volumetric_errors(model: ModelFile, cell: Path, seed: int, folder: Path, count: int = 512) -> Floats:
    """Distances (count,), mm, between predicted and true tool centre points, the best rigid fit removed."""
    readings = workspace(model, count)
    predicted = np.array(model.predict(readings).poses)[:, :3, 3]
    true = truth(cell, seed, readings, folder)
    fit = best_rigid(predicted, true)
    return np.linalg.norm(fit.apply(predicted) - true, axis=1)


def best_rigid(moving: Floats, fixed: Floats) -> RigidTransform:
    """The rigid motion that brings the points `moving` (N, 3) nearest to `fixed` (N, 3)."""
    a, b = moving.mean(axis=0), fixed.mean(axis=0)
    turn, _ = Rotation.align_vectors(fixed - b, moving - a)
    return RigidTransform.from_components(b - turn.apply(a), turn)
