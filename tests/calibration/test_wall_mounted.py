"""A robot on a wall, its weight and springs by the energy of masses written here: fitted as it stands, and as not."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from cellctl.calibration import Split, fit
from cellctl.formats import DataSet, RobotFile, measurements
from tests.helpers.own_model import Floats, OwnArm, kr5
from tests.helpers.simulated_setups import KR5_REGION, erroneous

KR5 = RobotFile.load(Path(__file__).parents[2] / "procedures" / "robots" / "kr5_r1400.yaml")
WALL = np.array([1.0, 0.0, 0.0])
G = 9.80665
KG = [0.0, 20.0, 6.0, 8.0, 2.0, 1.5]
AT_MM = [(0, 0, 0), (-250, 10, 30), (20, -30, 0), (5, -10, -200), (0, 20, 5), (30, 25, 200)]
STIFFNESS = np.array([2.0e5, 2.0e5, 1.2e5, 4.0e4, 4.0e4, 2.0e4])
"""N m/rad."""

BEND, NOISE_MM = 0.0008, 0.02


@dataclass(frozen=True)
class Hung:
    """An arm whose links (kg, and where behind each joint, mm) hang on springs, and whose tool is a cantilever."""

    arm: OwnArm
    down: Floats

    def energy(self, q: Floats) -> Floats:
        """Of the weights (N,), N m, at joint angles q (N, 6)."""
        total = np.zeros(len(q))
        for link, (mass, place) in enumerate(zip(KG, AT_MM, strict=True), 1):
            behind = replace(self.arm, table=self.arm.table[:link]).flange(q[:, :link])
            total -= mass * G * (behind @ np.append(place, 1.0))[:, :3] @ self.down / 1000.0
        return total

    def points(self, q: Floats) -> Floats:
        """Tool centre points (N, 3), mm, where springs and weights hold each other, and the tool bent."""
        rest = q
        for _ in range(6):
            slopes = [(self.energy(rest + step) - self.energy(rest - step)) / 2e-5 for step in 1e-5 * np.eye(6)]
            rest = q - np.stack(slopes, axis=1) / STIFFNESS
        flange = self.arm.flange(rest)
        axis = flange[:, :3, 2]
        across = self.down - (axis @ self.down)[:, None] * axis
        return (flange @ self.arm.tool)[:, :3, 3] + BEND * self.arm.sag_mm * across


def data_of(rng, count=300):
    nominal = kr5()
    hung = Hung(erroneous(rng, nominal, nominal.link_names), WALL)
    q = rng.uniform(KR5_REGION[0], KR5_REGION[1], (count, 6))
    xyz = hung.points(q) + np.array([900.0, -400.0, 1500.0]) + rng.normal(0.0, NOISE_MM, (count, 3))
    readings = KR5.joint_map().readings(q)
    names = [*(f"A{joint}" for joint in range(1, 7)), "X", "Y", "Z", "sX", "sY", "sZ"]
    rows = np.column_stack([readings, xyz, np.full((count, 3), NOISE_MM)]).tolist()
    return DataSet.of_records(dict(zip(names, row, strict=True)) for row in rows)


def fitted(data, mounting, model="geometry+deflection+compliance"):
    robot = RobotFile.model_validate({**KR5.model_dump(), "mounting": mounting})
    measured = measurements(robot, data, model=model)
    return fit(measured.task, Split.holdout(len(measured.lines), 0.3, 0))


@pytest.fixture(scope="module")
def data():
    return data_of(np.random.default_rng(4))


@pytest.fixture(scope="module")
def as_it_hangs(data):
    return fitted(data, "wall")


@pytest.mark.long
def test_a_robot_on_a_wall_is_found_to_its_noise_as_it_hangs_and_not_as_if_it_stood(data, as_it_hangs):
    upright = fitted(data, "floor")
    least = NOISE_MM * np.sqrt(3.0)
    assert as_it_hangs.test.rms < 1.15 * least
    assert as_it_hangs.coverage_95 > 0.88
    assert upright.test.rms > 10.0 * as_it_hangs.test.rms
    assert fitted(data, {"tilt": [33, 90, 0]}).test.rms == pytest.approx(as_it_hangs.test.rms, rel=1e-6)


def test_what_bends_under_the_weight_is_found_with_its_size(as_it_hangs):
    found = as_it_hangs.identification.identified
    model, sigma = found.state.model, np.sqrt(np.diag(found.covariance))
    values = dict(zip(model.names, zip(model.deviations, sigma, strict=False), strict=True))
    bend, spread = values["tool_deflection"]
    assert abs(bend - BEND) < 4.0 * spread
    assert spread < 0.3 * BEND
    first = [value for name, (value, _) in values.items() if name.startswith("compliance1_")]
    assert np.linalg.norm(first) > 1e-4  # the first joint carries the arm sideways


@pytest.mark.long
def test_auto_finds_out_that_a_robot_on_a_wall_bends_under_its_weight(data):
    steps = {step.model: step for step in fitted(data, "wall", "auto").ladder}
    assert steps["geometry+compliance"].kept
    assert steps["geometry+compliance"].gain_mm > 0.05
