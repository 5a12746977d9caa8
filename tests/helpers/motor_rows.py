"""Data sets with motor currents from the simulated world: drives that turn by the weight alone, or by friction too."""

from __future__ import annotations

import csv
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from cellctl.kinematics import Floats
from sims.cell import ERRORS, read_cell
from sims.conditions import Conditions
from sims.world.world import World

ROOT = Path(__file__).parents[2]
ROBOT = ROOT / "procedures/robots/kr5_r1400.yaml"
CELL = ROOT / "procedures/cells/sphere_cell.yaml"
REGION = np.array([[-40, -110, 50, -70, 20, -90], [40, -50, 110, 70, 85, 90]], float)
CURRENT_NOISE_A = 0.01


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


def world(seed: int, friction: float, compliance: float = 4.0) -> World:
    """A KR5 with errors of geometry and flexible drives; friction: the share that winds them up."""
    cell = read_cell(CELL)
    on = {"geometry": 1.0, "joint_zero": 1.0, "compliance": compliance, "friction_torsion": friction}
    return World(replace(cell, simulate=replace(cell.simulate, errors=dict.fromkeys(ERRORS, 0.0) | on)), seed)


def motor_rows(one: World, count: int, seed: int, noise_mm: float = 0.02) -> MotorRows:
    """Random postures, each approached from random sides, with the currents at rest and the TCP."""
    rng = np.random.default_rng(seed)
    readings, ways = rng.uniform(*REGION, (count, 6)), rng.choice([-1.0, 1.0], (count, 6))
    still = (0.0,) * 6
    currents = [
        np.add(one.holding_currents(q), one.motors.friction(way, still)) for q, way in zip(readings, ways, strict=True)
    ]
    true = np.array([one.true_tcp(q, Conditions(tuple(way))) for q, way in zip(readings, ways, strict=True)])
    noisy = np.array(currents) + rng.normal(0.0, CURRENT_NOISE_A, (count, 6))
    return MotorRows(readings, noisy, ways, true, true + rng.normal(0.0, noise_mm, (count, 3)))
