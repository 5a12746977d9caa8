"""An identification with two loads: it predicts between them, and refuses beyond them or at another centre of gravity.

Rows are those of a simulated KR5 with errors of geometry, flexible joints and a bending tool.
"""

import csv
import json
from dataclasses import replace
from math import dist

import numpy as np
import pytest

from cellctl.cli import exit_codes
from cellctl.cli.verbs import app
from sims.cell import read_cell
from sims.conditions import Conditions
from sims.world import World

LOW, HIGH = np.array([-90, -110, 40, -170, -100, -170.0]), np.array([90, -30, 120, 170, 100, 170.0])
AT = (20.0, 0.0, 90.0)
NOISE = 0.02
ERRORS = ("geometry", "joint_zero", "tool", "deflection", "compliance")
COLUMNS = ["A1", "A2", "A3", "A4", "A5", "A6", "X", "Y", "Z", "payload", "payload_x", "payload_y", "payload_z"]


@pytest.fixture(scope="module")
def world(request):
    cell = read_cell(request.config.rootpath / "procedures/cells/sphere_cell.yaml")
    errors = {**dict.fromkeys(cell.simulate.errors, 0.0), **dict.fromkeys(ERRORS, 1.0)}
    return World(replace(cell, simulate=replace(cell.simulate, errors=errors)), 1)


def rows(world, loads, count, noise, at=AT):
    rng = np.random.default_rng([int(10 * sum(loads)), count])
    found = []
    for number in range(count):
        readings, kg = rng.uniform(LOW, HIGH), loads[number % len(loads)]
        place = world.true_tcp(list(readings), Conditions(payload_kg=kg, payload_at=at))
        found.append([*readings, *(place + rng.normal(0.0, noise, 3)), kg, *at])
    return found


def write(path, found):
    lines = [",".join(COLUMNS), *(",".join(f"{value:.6f}" for value in row) for row in found)]
    path.write_text("\n".join(lines) + "\n")
    return path


def cellctl(*words):
    return exit_codes.exit_code_of(lambda: app([str(word) for word in words], standalone_mode=False))


@pytest.fixture(scope="module")
def model(world, request, tmp_path_factory):
    """Identified from rows without load and with 6 kg."""
    folder = tmp_path_factory.mktemp("loads")
    data = write(folder / "rows.csv", rows(world, [0.0, 6.0], 160, NOISE))
    robot = request.config.rootpath / "procedures/robots/kr5_r1400.yaml"
    out = folder / "model.json"
    assert cellctl("fit", robot, data, "--model", "geometry+compliance+deflection", "--out", out) == 0
    return out


@pytest.mark.long
def test_between_the_loads_it_predicts_within_its_sigma(model, world, tmp_path):
    """3 kg were never measured. 60 unknowns of 480 numbers with 0.02 mm leave 0.01 mm."""
    data = write(tmp_path / "between.csv", rows(world, [3.0], 40, 0.0))
    assert cellctl("predict", model, data, "-o", tmp_path / "out.csv") == 0
    found, true = (list(csv.DictReader(path.open())) for path in (tmp_path / "out.csv", data))
    places = ([[float(row[axis]) for axis in "XYZ"] for row in each] for each in (found, true))
    errors = np.array([dist(*pair) for pair in zip(*places, strict=True)])
    stated = np.array([float(row["sigma"]) for row in found])
    assert np.sqrt(np.mean(errors**2)) < 0.025
    assert np.mean(errors < 1.61 * stated) > 0.9
    unloaded = [dist(world.true_tcp(row[:6]), row[6:9]) for row in rows(world, [3.0], 40, 0.0)]
    assert np.mean(unloaded) > 0.1  # what ignoring the load would cost


@pytest.mark.long
def test_with_fewer_loaded_rows_what_a_load_does_is_less_certain(model, world, request, tmp_path):
    """10 loaded rows instead of 80: about √8 times the σ, less what the prior knows."""
    few = rows(world, [0.0], 150, NOISE) + rows(world, [6.0], 10, NOISE)
    data, out = write(tmp_path / "few.csv", few), tmp_path / "few.json"
    robot = request.config.rootpath / "procedures/robots/kr5_r1400.yaml"
    assert cellctl("fit", robot, data, "--model", "geometry+compliance+deflection", "--out", out) == 0
    many, fewer = (
        {each["name"]: each["sigma"] for each in json.loads(path.read_text())["parameters"]} for path in (model, out)
    )
    ratios = [fewer[f"compliance_load{joint}"] / many[f"compliance_load{joint}"] for joint in (2, 3, 5)]
    assert min(ratios) > 1.5


@pytest.mark.parametrize(
    ("load", "at", "reason"),
    [
        (8.0, AT, "payload is 8 kg, and the model was identified with 0 … 6 kg"),
        (3.0, (20.0, 0.0, 200.0), "the payload's centre of gravity is at (20, 0, 200) mm of the flange"),
    ],
)
def test_beyond_the_loads_or_at_another_centre_of_gravity_it_refuses(model, world, load, at, reason, tmp_path, capsys):
    data = write(tmp_path / "joints.csv", [*rows(world, [3.0], 1, 0.0), *rows(world, [load], 1, 0.0, at)])
    assert cellctl("predict", model, data, "-o", tmp_path / "out.csv") == 2
    error = capsys.readouterr().err
    assert f"joints.csv:3: {reason}" in error
    assert "identify from rows with" in error
    assert not (tmp_path / "out.csv").exists()


def test_a_load_without_its_centre_of_gravity_is_refused_where_the_fit_knows_it(model, world, tmp_path, capsys):
    data = tmp_path / "joints.csv"
    data.write_text("A1,A2,A3,A4,A5,A6,payload\n0,-90,90,0,45,0,3\n0,-90,90,0,45,0,0\n")
    assert cellctl("predict", model, data) == 2
    error = capsys.readouterr().err
    assert "joints.csv:2: the payload's centre of gravity is at the TCP" in error
    assert "joints.csv:3" not in error


def test_a_fit_of_loads_with_two_centres_of_gravity_is_refused(world, request, tmp_path, capsys):
    both = rows(world, [5.0], 20, NOISE) + rows(world, [5.0], 20, NOISE, (0.0, 0.0, 200.0))
    data = write(tmp_path / "rows.csv", both)
    assert cellctl("fit", request.config.rootpath / "procedures/robots/kr5_r1400.yaml", data) == 2
    error = capsys.readouterr().err
    assert "rows.csv:22: the payload's centre of gravity is another one than in line 2" in error
    assert "data set of its own" in error


@pytest.mark.long
def test_a_loaded_row_without_its_centre_is_rejected_where_others_have_it(world, request, tmp_path, capsys):
    data = write(tmp_path / "rows.csv", rows(world, [0.0, 6.0], 60, NOISE))
    lines = data.read_text().splitlines()
    lines[2] = ",".join([*lines[2].split(",")[:10], "", "", ""])
    data.write_text("\n".join(lines) + "\n")
    robot = request.config.rootpath / "procedures/robots/kr5_r1400.yaml"
    assert cellctl("fit", robot, data, "--model", "geometry") in (0, 3)
    found = capsys.readouterr()
    assert "payload_x is missing" in found.out + found.err
