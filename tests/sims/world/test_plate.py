"""The sphere plate as it stands in the simulated cell."""

from __future__ import annotations

from dataclasses import replace
from math import acos, degrees, dist
from pathlib import Path

import numpy as np
import pytest

from sims.cell import read_cell
from sims.world.true_places import true_spheres

ARTEFACT = read_cell(Path(__file__).parents[3] / "procedures/cells/sphere_cell.yaml").artefact
SEEDS = range(1, 41)


def spacing_errors(seed, scale=1.0, artefact=ARTEFACT):
    centres = {sphere.id: sphere.centre for sphere in true_spheres(artefact, seed, scale)}
    return [dist(*(centres[name] for name in d.between)) - d.mm for d in artefact.distances]


def centres(seed, scale):
    return np.array([sphere.centre for sphere in true_spheres(ARTEFACT, seed, scale)])


def test_true_spacings_scatter_about_the_certificate_by_its_sigma():
    errors = np.array([spacing_errors(seed) for seed in SEEDS])
    assert np.abs(errors).max() < 0.05
    assert np.sqrt(np.mean(errors**2)) == pytest.approx(0.01, rel=0.2)


def test_without_placement_error_the_spacings_are_as_certified_and_the_plate_near_its_rough_place():
    assert spacing_errors(1, 0.0) == pytest.approx([0.0] * 3, abs=1e-6)
    rough = np.array([sphere.centre for sphere in ARTEFACT.spheres])
    assert np.abs(centres(1, 0.0) - rough).max() < 1.0


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_plate_stands_two_millimetres_and_three_tenths_of_a_degree_off(seed):
    rough, true = centres(seed, 0.0), centres(seed, 1.0)
    assert dist(true.mean(axis=0), rough.mean(axis=0)) == pytest.approx(2.0, abs=0.02)
    u, _, vt = np.linalg.svd((rough - rough.mean(axis=0)).T @ (true - true.mean(axis=0)))
    rotation = vt.T @ np.diag([1, 1, np.linalg.det(vt.T @ u.T)]) @ u.T
    assert degrees(acos((np.trace(rotation) - 1) / 2)) == pytest.approx(0.3, abs=0.005)


def test_spheres_without_distances_keep_their_rough_places_to_each_other():
    loose = replace(ARTEFACT, distances=())
    rough = [sphere.centre for sphere in ARTEFACT.spheres]
    true = [sphere.centre for sphere in true_spheres(loose, 1, 1.0)]
    assert dist(true[0], true[2]) == pytest.approx(dist(rough[0], rough[2]), abs=1e-9)


def test_a_cell_without_spheres_has_none():
    assert true_spheres(replace(ARTEFACT, spheres=(), distances=()), 1, 1.0) == []


def test_contact_is_at_the_spheres_radius_and_the_tips():
    assert [sphere.touch_mm for sphere in true_spheres(ARTEFACT, 1, 1.0)] == [61.4 / 2 + 0.6] * len(ARTEFACT.spheres)
