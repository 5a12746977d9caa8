"""What stands in the simulated robot's way, against figures worked out by hand."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sims.cell import Plate, read_cell
from sims.world import World
from sims.world._obstacles import Obstacles

FAR = (0.0, 0.0, 5000.0)
SPHERE = ((0.0, 0.0, 200.0), 30.0)
CELL = read_cell(Path(__file__).parents[3] / "procedures/cells/sphere_cell.yaml")


def gap(flange, tip, plate_z=0.0, spheres=(SPHERE,), elbow=None, wrist=None):
    """Of a robot whose forearm and wrist are where the flange is, unless said otherwise."""
    return Obstacles(spheres, plate_z, 10.0).gap(elbow or flange, wrist or flange, flange, tip)


def test_the_wrist_is_sixty_millimetres_round():
    assert gap((1000.0, 0.0, 100.0), (1400.0, 0.0, 100.0)) == pytest.approx(40.0)


def test_the_shaft_is_five_millimetres_round_up_to_its_mouth_and_the_wire_a_line():
    assert gap((1000.0, 0.0, 425.0), (1000.0, 0.0, 2.0)) == pytest.approx(2.0)
    assert gap((1000.0, 0.0, 425.0), (1000.0, 0.0, -3.0)) == pytest.approx(-3.0)
    assert gap((1000.0, 0.0, 425.0), (1400.0, 0.0, 2.0)) == pytest.approx(2.0)


def test_a_tip_on_the_sphere_is_no_collision_and_the_shaft_is():
    straight_down = (0.0, 0.0, 230.0)
    assert gap((0.0, 0.0, 640.0), straight_down) > 0.0
    assert gap((0.0, 0.0, 640.0), (0.0, 0.0, 200.0)) == pytest.approx(25.0 - 30.0 - 5.0)


def test_the_stem_is_in_the_way_from_plate_to_sphere():
    across = {"flange": (-400.0, 12.0, 100.0), "tip": (400.0, 12.0, 100.0)}
    assert gap(**across, elbow=FAR, wrist=FAR) == pytest.approx(12.0 - 10.0 - 5.0)
    assert gap(**across, elbow=FAR, wrist=FAR, plate_z=None, spheres=()) == float("inf")


def test_the_forearm_counts_too():
    high = {"flange": (1000.0, 0.0, 900.0), "tip": (1000.0, 0.0, 600.0), "wrist": (1000.0, 0.0, 500.0)}
    assert gap(**high, elbow=(-1000.0, 0.0, 500.0)) == pytest.approx(300.0 - 30.0 - 60.0)


def test_distances_between_bodies_are_those_of_their_nearest_points():
    random = np.random.default_rng(2)
    shares = np.linspace(0.0, 1.0, 401)[:, None]
    for a, b in random.normal(0.0, 150.0, (40, 2, 3)):
        points = a + shares * (b - a)
        stem = np.array([0.0, 0.0, 200.0]) * shares
        sampled = np.linalg.norm(points[:, None] - stem, axis=-1).min()
        found = Obstacles((((0.0, 0.0, 200.0), -1e6),), 0.0, 0.0)._to_stand(tuple(a), tuple(b), 0.0)
        expected = min(sampled, min(a[2], b[2]))
        assert found == pytest.approx(expected, abs=2.0)
        assert found <= expected + 1e-9


def test_the_plate_is_moved_as_its_spheres_are():
    still = replace(CELL, simulate=replace(CELL.simulate, errors=dict.fromkeys(CELL.simulate.errors, 0.0)))
    shifted = replace(still, simulate=replace(still.simulate, errors={**still.simulate.errors, "placement": 1.0}))
    low = (0.0, 20.0, 60.0, 0.0, 20.0, 0.0)
    bare, moved = World(still, 1), World(shifted, 1)
    raised = np.mean([b.centre[2] - a.centre[2] for a, b in zip(bare.spheres, moved.spheres, strict=True)])
    assert raised != 0.0
    assert bare.free(low) < 0.0, "the plate is what is nearest"
    assert moved.free(low) - bare.free(low) == pytest.approx(-raised, abs=1e-9)


def test_a_cell_without_a_plate_has_none():
    hanging = replace(CELL, artefact=replace(CELL.artefact, plate=None))
    sunk = replace(CELL, artefact=replace(CELL.artefact, plate=Plate(-5000.0, 1e-6)))
    home = (0.0, -90.0, 90.0, 0.0, 45.0, 0.0)
    assert World(hanging, 1).free(home) == pytest.approx(World(sunk, 1).free(home))
