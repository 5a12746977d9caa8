"""Points and data sets of the simulated world, and how good an identified robot is against its truth.

The workspace of `volumetric_errors`: tool tip in a box of 700 × 1000 × 650 mm before the robot, shaft within 60° of
straight down, any spin. `motor_rows` are data sets with motor currents: drives that turn by the weight alone, or by
friction too. `example_rows` are the console's example: a simulated KR5 R1400 with errors of its own, measured by a
tracker at a place of its own; `write_example` writes the file again.
"""

from __future__ import annotations

import csv
import random
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import yaml
from scipy.spatial.transform import RigidTransform, Rotation
from scipy.stats import qmc

from cellctl.formats import ModelFile, RobotFile
from cellctl.kinematics import Floats, inverse
from sims.cell import ERRORS, read_cell
from sims.conditions import Conditions
from sims.world.world import World
from tests.helpers import arms

LOW, HIGH = np.array([650.0, -500.0, 50.0]), np.array([1350.0, 500.0, 700.0])

ROOT = Path(__file__).parents[2]
KR5_FILE = ROOT / "procedures/robots/kr5_r1400.yaml"
SPHERE_CELL = ROOT / "procedures/cells/sphere_cell.yaml"
MOTOR_REGION = np.array([[-40, -110, 50, -70, 20, -90], [40, -50, 110, 70, 85, 90]], float)
CURRENT_NOISE_A = 0.01

TRACKER_CELL = ROOT / "procedures" / "cells" / "tracker_cell.yaml"
EXAMPLE_SEED, EXAMPLE_ROWS, EXAMPLE_NOISE_MM = 5, 100, 0.03
EXAMPLE_REGION_DEG = ((-60, 60), (-110, -50), (60, 120), (-90, 90), (20, 80), (-120, 120))


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


def true_points(cell: Path, seed: int, readings: Floats, folder: Path) -> Floats:
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
    true = true_points(cell, seed, readings, folder)
    fit = best_rigid(predicted, true)
    return np.linalg.norm(fit.apply(predicted) - true, axis=1)


def best_rigid(moving: Floats, fixed: Floats) -> RigidTransform:
    """The rigid motion that brings the points `moving` (N, 3) nearest to `fixed` (N, 3)."""
    a, b = moving.mean(axis=0), fixed.mean(axis=0)
    turn, _ = Rotation.align_vectors(fixed - b, moving - a)
    return RigidTransform.from_components(b - turn.apply(a), turn)


@dataclass(frozen=True, eq=False)
class MotorRows:
    """readings, currents (N, 6): deg, A, as the controller counts. ways (N, 6): of approach. true, xyz (N, 3), mm."""

    readings: Floats
    currents: Floats
    ways: Floats
    true: Floats
    xyz: Floats

    def write(self, path: Path, held_out: int, *, currents: bool = True, ways: bool = True) -> Path:
        """As a data set; the last `held_out` rows judge."""
        names = [*(f"A{j}" for j in range(1, 7)), "X", "Y", "Z", "sX", "sY", "sZ", "set"]
        names += [f"I{j}" for j in range(1, 7)] * currents + [f"D{j}" for j in range(1, 7)] * ways
        with path.open("w", newline="") as target:
            table = csv.writer(target)
            table.writerow(names)
            for row in range(len(self.readings)):
                cells = [*self.readings[row], *self.xyz[row], 0.02, 0.02, 0.02]
                cells.append("test" if row >= len(self.readings) - held_out else "fit")
                cells += [*self.currents[row]] * currents + [*self.ways[row].astype(int)] * ways
                table.writerow(cells)
        return path


def motor_world(seed: int, friction: float, compliance: float = 4.0) -> World:
    """A KR5 with errors of geometry and flexible drives; friction: the share that winds them up."""
    cell = read_cell(SPHERE_CELL)
    on = {"geometry": 1.0, "joint_zero": 1.0, "compliance": compliance, "friction_torsion": friction}
    return World(replace(cell, simulate=replace(cell.simulate, errors=dict.fromkeys(ERRORS, 0.0) | on)), seed)


def motor_rows(one: World, count: int, seed: int, noise_mm: float = 0.02) -> MotorRows:
    """Random postures, each approached from random sides, with the currents at rest and the TCP."""
    rng = np.random.default_rng(seed)
    readings, ways = rng.uniform(*MOTOR_REGION, (count, 6)), rng.choice([-1.0, 1.0], (count, 6))
    still = (0.0,) * 6
    currents = [
        np.add(one.holding_currents(q), one.motors.friction(way, still)) for q, way in zip(readings, ways, strict=True)
    ]
    true = np.array([one.true_tcp(q, Conditions(tuple(way))) for q, way in zip(readings, ways, strict=True)])
    noisy = np.array(currents) + rng.normal(0.0, CURRENT_NOISE_A, (count, 6))
    return MotorRows(readings, noisy, ways, true, true + rng.normal(0.0, noise_mm, (count, 3)))


def example_rows() -> Iterator[tuple[list[float], list[float]]]:
    """Joints, degrees, and the TCP in the tracker's frame with its noise, mm."""
    cell = read_cell(TRACKER_CELL)
    world, draw = World(cell, EXAMPLE_SEED), random.Random(EXAMPLE_SEED)
    turn = Rotation.from_euler("z", 150.0, degrees=True)
    for _ in range(EXAMPLE_ROWS):
        joints = [round(draw.uniform(*limits), 3) for limits in EXAMPLE_REGION_DEG]
        tcp = np.array(world.true_tcp(joints)) + world.scatter(joints, 0) - (3400.0, -1200.0, 900.0)
        yield joints, [place + draw.gauss(0.0, EXAMPLE_NOISE_MM) for place in turn.inv().apply(tcp).tolist()]


def example_text() -> str:
    """The data set as CSV."""
    lines = [",".join(f"{value:.3f}" for value in (*joints, *place)) for joints, place in example_rows()]
    return "\n".join(["A1,A2,A3,A4,A5,A6,X,Y,Z", *lines, ""])


def write_example() -> None:
    """Write the console's example again."""
    from cellctl.operations.analyses import EXAMPLE

    EXAMPLE.write_text(example_text())


def positions_in_the_heat(per_k: Floats, *, warm: bool = True) -> str:
    """A data set of 120 positions of the elbow arm, from 15 to 35 °C, whose tool moves by `per_k` (3,), mm/K, along the
    flange's axes; with the column `temperature` where `warm`.
    """
    rng = np.random.default_rng(4)
    robot = RobotFile.model_validate(yaml.safe_load(arms.ELBOW_ROBOT))
    readings = arms.drawn(rng, 120)
    celsius = rng.uniform(15.0, 35.0, 120)
    flange = robot.chain().forward_flange(robot.joint_map().model(readings))[:, :3, :3]
    places = arms.ElbowArm().tcp(readings) + (flange @ per_k) * (celsius - 20.0)[:, None]
    columns = arms.joints_and_places(readings, places + rng.normal(0.0, 0.01, (120, 3)))
    return arms.csv_text({**columns, "temperature": [f"{each:.3f}" for each in celsius]} if warm else columns)
