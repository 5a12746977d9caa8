"""Touches of the studies are where the tip of the simulated robot meets the sphere."""

import numpy as np
import pytest

from tests.studies.papers.spherical_constraint import CELL, without_beta
from tests.studies.papers.touching import TouchCell, contacts
from tests.studies.papers.world import PaperWorld


@pytest.fixture(scope="module")
def cell():
    return TouchCell.load(CELL)


@pytest.fixture(scope="module")
def planned(cell):
    return cell.planned([12], 1)


def test_each_contact_is_on_the_true_sphere_but_for_the_scatter(cell, planned):
    world = PaperWorld.of(CELL, 1)
    readings = contacts(world.world, planned)
    assert len(readings) == 12
    (sphere,) = world.world.spheres
    distance = np.linalg.norm(world.points(readings) - sphere.centre, axis=1)
    np.testing.assert_allclose(distance, sphere.touch_mm, atol=0.08)
    assert np.abs(distance - sphere.touch_mm).max() > 0.005


def test_without_scatter_each_contact_is_on_the_sphere(cell, planned):
    world = PaperWorld.of(CELL, 1, {"repeatability": 0.0})
    (sphere,) = world.world.spheres
    distance = np.linalg.norm(world.points(contacts(world.world, planned)) - sphere.centre, axis=1)
    np.testing.assert_allclose(distance, sphere.touch_mm, atol=1e-6)


def test_plain_dh_has_the_same_robot_and_no_beta(cell):
    chain = cell.robot.chain()
    plain = without_beta(chain)
    q = np.random.default_rng(1).uniform(-1.0, 1.0, (5, 6))
    np.testing.assert_allclose(plain.forward(q), chain.forward(q), atol=1e-9)
    assert set(chain.parameters) - set(plain.parameters) == {"beta2"}
    assert set(plain.parameters) - set(chain.parameters) == {"d2"}
