"""A three-joint arm in closed form, 0.8 mm and 0.03° from its table, and the files that the command line takes."""

import math

import numpy as np
import pytest

from cellctl.cli import exit_codes
from cellctl.cli.verbs import app

ROBOT = """\
name: elbow arm
convention: mdh-hayati
links:
  - {theta: 0, d: 400, a: 0, alpha: 90}
  - {theta: 0, a: 500, alpha: 0, beta: 0}
  - {theta: 0, d: 0, a: 450, alpha: 0}
joints:
  - {min: -180, max: 180, max_speed: 100}
  - {min: -180, max: 180, max_speed: 100}
  - {min: -180, max: 180, max_speed: 100}
repeatability: 0.03
"""
CENTRES = {"S1": (600.0, -200.0, 300.0), "S2": (600.0, 200.0, 350.0)}
ARTEFACT = """\
tip_radius: 1.0
spheres:
  - {id: S1, diameter: 60, centre: [601, -200, 300]}
  - {id: S2, diameter: 60, centre: [600, 201, 350]}
distances:
  - {between: [S1, S2], mm: 403.113, sigma: 0.01}
"""
UPPER, FORE, ELBOW_ZERO = 500.8, 449.3, 0.03


def tip(a1, a2, a3, upper=UPPER, fore=FORE, zero=ELBOW_ZERO):
    turn, shoulder, elbow = math.radians(a1), math.radians(a2), math.radians(a2 + a3 + zero)
    out = upper * math.cos(shoulder) + fore * math.cos(elbow)
    height = 400 + upper * math.sin(shoulder) + fore * math.sin(elbow)
    return np.array([out * math.cos(turn), out * math.sin(turn), height])


def joints_at(point):
    """Elbow-up readings at which the true arm's tip is at `point`."""
    out, height = math.hypot(point[0], point[1]), point[2] - 400
    elbow = -math.acos((out**2 + height**2 - UPPER**2 - FORE**2) / (2 * UPPER * FORE))
    shoulder = math.atan2(height, out) - math.atan2(FORE * math.sin(elbow), UPPER + FORE * math.cos(elbow))
    return [math.degrees(math.atan2(point[1], point[0])), math.degrees(shoulder), math.degrees(elbow) - ELBOW_ZERO]


def csv_of(names, rows):
    return "\n".join([",".join(names), *(",".join(str(value) for value in row) for row in rows)]) + "\n"


@pytest.fixture
def files(tmp_path):
    """Robot, artefact, positions (`set` in the last column) and touches."""
    rng = np.random.default_rng(4)
    readings = rng.uniform([-90, 10, -120], [90, 80, -30], (60, 3))
    instrument = np.array([1000, 20, -30])
    points = [tip(*row) + instrument + rng.normal(0, 0.017, 3) for row in readings]
    sets = ["fit"] * 40 + ["test"] * 20
    positions = [[*row, *point, which] for row, point, which in zip(readings, points, sets, strict=True)]
    touches = []
    for count in range(60):
        name = ("S1", "S2")[count % 2]
        away = rng.normal((0, 0, 0.5), 1.0)
        touches.append([*joints_at(np.array(CENTRES[name]) + 31.0 * away / np.linalg.norm(away)), name])
    (tmp_path / "robot.yaml").write_text(ROBOT)
    (tmp_path / "artefact.yaml").write_text(ARTEFACT)
    (tmp_path / "positions.csv").write_text(csv_of(["A1", "A2", "A3", "X", "Y", "Z", "set"], positions))
    (tmp_path / "touches.csv").write_text(csv_of(["A1", "A2", "A3", "sphere"], touches))
    return tmp_path


@pytest.fixture
def cellctl(files, monkeypatch):
    """Runs the command line in the folder of the files; the exit code."""
    monkeypatch.chdir(files)
    return lambda *words: exit_codes.exit_code_of(lambda: app([str(word) for word in words], standalone_mode=False))
