"""A robot of a class of its own: screws and 4×4 products written here, errors drawn on screws, never our chain."""

from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from cellctl.calibration import SpacingRows, Task, TouchRows
from cellctl.formats import RobotFile, nominal_model
from tests.helpers.own_model import KR5_TABLE

ROBOTS = Path(__file__).parents[2] / "procedures" / "robots"

SIGNS = np.array([-1, 1, 1, -1, 1, -1])
TOOL = np.array([59.9, 50.5, 410.3])
SPHERES = {"S1": [950.0, -350.0, 250.0], "S2": [950.0, 350.0, 250.0], "S3": [1150.0, 0.0, 400.0]}
REACH = 61.4 / 2 + 0.6


def frame(rotation, place):
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation.as_matrix(), place
    return matrix


def table_row(theta, d, a, alpha):
    return frame(Rotation.from_euler("z", theta, degrees=True), [0, 0, d]) @ frame(
        Rotation.from_euler("x", alpha, degrees=True), [a, 0, 0]
    )


@dataclass
class ScrewRobot:
    """Joint axes (point, direction) in the base at model zero, and the flange's pose there."""

    points: np.ndarray
    axes: np.ndarray
    home: np.ndarray
    zero: np.ndarray
    tool: np.ndarray
    bend: float = 0.0

    def flange(self, readings):
        matrix = np.eye(4)
        for point, axis, angle in zip(self.points, self.axes, np.deg2rad(SIGNS * readings) + self.zero, strict=True):
            turn = Rotation.from_rotvec(angle * axis)
            matrix = matrix @ frame(turn, point - turn.apply(point))
        return matrix @ self.home

    def tcp(self, readings):
        flange = self.flange(readings)
        axis = flange[:3, 2]
        sag = np.array([0, 0, -1.0]) + axis[2] * axis
        return flange[:3, :3] @ self.tool + flange[:3, 3] + self.bend * sag


def nominal_screws():
    points, axes, matrix = [], [], np.eye(4)
    for theta, d, a, alpha in KR5_TABLE:
        points.append(matrix[:3, 3].copy())
        axes.append(matrix[:3, 2].copy())
        matrix = matrix @ table_row(theta, d, a, alpha)
    return ScrewRobot(np.array(points), np.array(axes), matrix, np.zeros(6), TOOL.copy())


def erroneous(rng, *, axes_mm=0.5, axes_deg=0.035, zero_deg=0.03, tool_mm=1.5, bend_mm=0.125):
    robot = nominal_screws()
    robot.points = robot.points + rng.normal(0, axes_mm, (6, 3))
    tilt = Rotation.from_rotvec(np.deg2rad(rng.normal(0, axes_deg, (6, 3))))
    robot.axes = tilt.apply(robot.axes)
    robot.zero = np.deg2rad(rng.normal(0, zero_deg, 6))
    direction = rng.normal(size=3)
    robot.tool = robot.tool + tool_mm * direction / np.linalg.norm(direction)
    robot.bend = bend_mm
    return robot


def touch(robot, rng, centre, noise_mm):
    """Readings at which the robot's tip is `REACH` from `centre`, in a random direction with a random orientation."""
    home = np.array([0.0, -70.0, 80.0, 0.0, 60.0, 0.0])
    while True:
        away = rng.normal(size=3)
        away /= np.linalg.norm(away)
        if away[2] < -0.3:
            continue
        goal = centre + (REACH + rng.normal(0, noise_mm)) * away
        start = home + rng.uniform(-25, 25, 6) * [1, 1, 1, 3, 1, 4]
        wrist = start[3:]
        found = least_squares(lambda arm, w=wrist, g=goal: robot.tcp(np.r_[arm, w]) - g, start[:3], xtol=1e-14)
        readings = np.r_[found.x, wrist]
        if np.linalg.norm(found.fun) < 1e-9 and abs(readings[0]) < 150 and -175 < readings[1] < 60:
            return readings


@dataclass
class Touches:
    readings: np.ndarray
    sphere: np.ndarray
    centres: np.ndarray
    robot: ScrewRobot


def draw_touches(seed, count, *, noise_mm=0.0173, spheres=None, robot=None):
    rng = np.random.default_rng(seed)
    robot = robot or erroneous(rng)
    spheres = spheres or list(SPHERES.values())
    centres = np.array(spheres) + rng.normal(0, 1.0, (len(spheres), 3))
    sphere = np.arange(count) % len(spheres)
    readings = np.array([touch(robot, rng, centres[index], noise_mm) for index in sphere])
    return Touches(readings, sphere, centres, robot)


@pytest.fixture(scope="session")
def touches():
    """50 + 30 touches on three spheres by a robot with errors."""
    return draw_touches(1, 80)


@pytest.fixture(scope="session")
def draw():
    """`draw_touches`: other seeds, counts and spheres."""
    return draw_touches


@pytest.fixture(scope="session")
def screw_robot():
    """A robot with errors of a robot of this class."""
    return erroneous(np.random.default_rng(7))


@pytest.fixture(scope="session")
def kr5():
    """The KR5 as its file says, and its joint map."""
    return RobotFile.load(ROBOTS / "kr5_r1400.yaml")


@pytest.fixture(scope="session")
def touch_task(kr5):
    """Makes a task from touches: certified spacings (± 0.01 mm) unless told otherwise."""

    def make(touches, *, spacings=True, deflection=True):
        rows = TouchRows(
            kr5.joint_map().model(touches.readings),
            touches.sphere,
            np.full(len(touches.sphere), REACH),
            np.full((len(touches.sphere), 1), kr5.repeatability / np.sqrt(3)),
        )
        names = tuple(SPHERES)[: len(touches.centres)]
        rough = np.array(list(SPHERES.values()))[: len(names)]
        certified = certificate(touches.centres) if spacings and len(names) > 1 else None
        return Task(nominal_model(kr5, touched=deflection), rows, names, rough, certified)

    return make


def certificate(centres, sigma=0.01):
    pairs = np.array(list(combinations(range(len(centres)), 2)))
    true = np.linalg.norm(centres[pairs[:, 0]] - centres[pairs[:, 1]], axis=1)
    written = true + np.random.default_rng(5).normal(0, sigma, len(pairs))
    return SpacingRows(pairs, written, np.full((len(pairs), 1), sigma))
