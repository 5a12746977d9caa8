"""A compensated program on the simulated robot, whose true tool is known: its points are right, and were not before."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from cellctl.formats import ModelFile, RobotFile
from cellctl.kinematics import inverse, pose_from_xyz_abc
from tests.helpers.arms import KR5_FILE
from tests.helpers.krl import BASE, CHAIN, JOINTS, Seam, config, position
from tests.helpers.simulated_data import best_rigid, true_points, workspace_of

CELL = Path(__file__).parents[3] / "procedures" / "cells" / "sphere_cell.yaml"
SEED = 4


@pytest.fixture(scope="module")
def postures():
    """Readings over the workspace: 104 for the fit, 24 for the program."""
    readings = workspace_of(RobotFile.load(KR5_FILE), 128)
    return readings[24:], readings[:24]


def places(readings, folder):
    return true_points(CELL, SEED, readings, folder)


@pytest.fixture
def programs(cellctl, folder, postures):
    """Wanted places, and the simulated robot's true ones with the original and with the compensated program; mm."""
    fitted, wanted = postures
    true = places(fitted, folder)
    rows = np.hstack([fitted, true])
    names = [*(f"A{axis}" for axis in range(1, 7)), *"XYZ"]
    (folder / "data.csv").write_text("\n".join([",".join(names), *(",".join(map(repr, row)) for row in rows.tolist())]))
    assert cellctl("fit", KR5_FILE, "data.csv", "--model", "geometry", "--out", "model.json") == 0
    seam = Seam()
    for number, readings in enumerate(wanted):
        seam.point(f"P{number}", position(readings))
        seam.form("PTP", f"P{number}")
    seam.write(folder)
    (folder / "$config.dat").write_text(config())
    (folder / "out").mkdir()
    command = ("compensate", "model.json", "seam.src", "--config", "$config.dat", "-o", "out", "--json", "all.json")
    assert cellctl(*command) == 1, "points outside the measured region are left as they were"
    changed = {one["name"] for one in json.loads((folder / "all.json").read_text())["points"]}
    chosen = [number for number in range(len(wanted)) if f"XP{number}" in changed]
    sent = controller(folder / "out" / "seam.dat", chosen, wanted)
    goals = CHAIN.forward(JOINTS.model(wanted[chosen]))[:, :3, 3]
    return goals, places(wanted[chosen], folder), places(sent, folder)


def controller(dat, chosen, near):
    """Readings of the nominal controller at points of a data list."""
    text, readings = dat.read_text("latin-1"), []
    for number in chosen:
        body = re.search(rf"XP{number}=\{{([^}}]*)\}}", text)[1]
        values = {label: float(value) for label, value in (part.split() for part in body.split(","))}
        pose = BASE @ pose_from_xyz_abc([values[name] for name in "XYZ"], [values[name] for name in "ABC"])
        found = inverse(CHAIN, pose, JOINTS.model(near[number]))
        assert found.converged
        readings.append(JOINTS.readings(found.q))
    return np.array(readings)


def off(places, goals):
    return float(np.sqrt(np.mean(np.sum((places - goals) ** 2, axis=1))))


@pytest.mark.long
def test_the_real_points_are_right_to_each_other_and_in_the_models_base(programs, folder):
    goals, before, after = programs
    assert len(goals) >= 15
    assert off(best_rigid(before, goals).apply(before), goals) > 1.0
    assert off(best_rigid(after, goals).apply(after), goals) < 0.05
    base = ModelFile.load(folder / "model.json").robot_model().chain.base_now
    assert off(after, goals @ base[:3, :3].T + base[:3, 3]) < 0.05
