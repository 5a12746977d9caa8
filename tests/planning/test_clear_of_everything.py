"""Whole plans against the simulated world's own geometry: nothing but the tip meets anything."""

from __future__ import annotations

from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from cellctl.formats import RobotFile, load_artefact
from cellctl.planning import PlannedTouch, Plate, SphereTarget, TouchOptions, plan_touches
from cellctl.planning.ways import Reach, Thickness, between_lines
from sims.cell import SimCell, read_cell
from sims.world import World
from tests.helpers.arms import KR5_POSTURES

PROCEDURES = Path(__file__).parents[2] / "procedures"
ROBOT = RobotFile.load(PROCEDURES / "robots" / "kr5_r1400.yaml")
LIMITS = Reach(*(tuple(column) for column in ROBOT.limits().T.tolist()))
FOREARM_HARD_AGAINST_IT = TouchOptions(thickness=Thickness(wrist=0.0, shaft=0.0), clearance=0.0)


@cache
def cell(name: str) -> SimCell:
    return read_cell(PROCEDURES / "cells" / name)


def planned(name: str, seed: int, options: TouchOptions, *, sees_plate: bool = True) -> list[PlannedTouch]:
    """A campaign's touches on every sphere of the cell, its plate known to the planner or (far below) not."""
    artefact = load_artefact(PROCEDURES / "cells" / name)
    assert artefact.plate is not None
    targets = [
        SphereTarget(sphere.id, (sphere.centre[0], sphere.centre[1], sphere.centre[2]), sphere.diameter / 2 + 0.6)
        for sphere in artefact.spheres
    ]
    plate = Plate(artefact.plate.z, artefact.plate.stem_radius) if sees_plate else Plate(-2000.0, 0.0)
    counts = [80 // len(targets)] * len(targets)
    return plan_touches(
        ROBOT.chain(),
        ROBOT.joint_map(),
        LIMITS,
        KR5_POSTURES,
        targets,
        counts,
        seed,
        options,
        plate=plate,
        reference_every=20,
    )


def least_free_mm(name: str, seed: int, touches: list[PlannedTouch]) -> float:
    """How near robot and obstacles of the simulated world come on all ways, searches to their very ends among them."""
    world = World(cell(name), seed)
    lines = [
        line
        for touch in touches
        for line in pairwise([touch.origin, *touch.approach, touch.start, touch.end, *touch.retreat])
    ]
    return min(world.free(q) for start, end in lines for q in np.linspace(start, end, 25).tolist())


@pytest.mark.parametrize("seed", [1, *(pytest.param(seed, marks=pytest.mark.long) for seed in (2, 3, 4, 5))])
def test_the_plans_of_a_campaign_keep_clear_of_spheres_stems_and_plate_as_they_truly_stand(seed: int) -> None:
    touches = planned("sphere_cell.yaml", seed, TouchOptions())
    assert least_free_mm("sphere_cell.yaml", seed, touches) > 0.0


def test_so_do_those_on_a_single_sphere() -> None:
    touches = planned("single_sphere_cell.yaml", 1, TouchOptions())
    assert least_free_mm("single_sphere_cell.yaml", 1, touches) > 0.0


@pytest.mark.long
def test_a_plan_that_knows_of_no_plate_runs_into_it() -> None:
    touches = planned("sphere_cell.yaml", 1, TouchOptions(), sees_plate=False)
    assert least_free_mm("sphere_cell.yaml", 1, touches) < -50.0


@pytest.mark.long
def test_a_plan_that_takes_the_robot_for_a_line_runs_into_something() -> None:
    touches = planned("sphere_cell.yaml", 1, FOREARM_HARD_AGAINST_IT)
    assert least_free_mm("sphere_cell.yaml", 1, touches) < -10.0


def test_wrists_are_turned_as_widely_as_a_calibration_needs_although_they_keep_clear() -> None:
    ends = np.array([touch.end for touch in planned("sphere_cell.yaml", 1, TouchOptions())])
    assert (np.ptp(ends, axis=0)[3:] > (200.0, 120.0, 250.0)).all()


def test_where_no_plate_is_known_nothing_goes_more_than_ten_centimetres_below_the_lowest_sphere() -> None:
    spheres = [SphereTarget("S1", (950.0, -350.0, 400.0), 31.3)]
    touches = plan_touches(ROBOT.chain(), ROBOT.joint_map(), LIMITS, KR5_POSTURES, spheres, [25], 4)
    ends = ROBOT.joint_map().model(np.array([touch.end for touch in touches]))
    assert ROBOT.chain().forward_flange(ends)[:, 2, 3].min() > 300.0 + Thickness().wrist


def test_the_distance_between_lines_is_that_of_their_nearest_points() -> None:
    random = np.random.default_rng(1)
    shares = np.linspace(0.0, 1.0, 201)
    for a, b, c, d in random.normal(0.0, 100.0, (50, 4, 3)):
        first, second = (start + shares[:, None] * (end - start) for start, end in ((a, b), (c, d)))
        sampled = np.linalg.norm(first[:, None] - second, axis=-1).min()
        exact = float(between_lines(a[None], b[None], c, d)[0])
        assert sampled - 3.0 < exact <= sampled + 1e-9


def test_a_line_without_length_is_a_point_and_parallel_lines_have_a_distance() -> None:
    origin, along, beside = np.zeros((1, 3)), np.array([[10.0, 0.0, 0.0]]), np.array([0.0, 4.0, 3.0])
    assert between_lines(origin, along, beside, beside)[0] == pytest.approx(5.0)
    assert between_lines(origin, along, beside, beside + along[0])[0] == pytest.approx(5.0)
    assert between_lines(origin, origin, beside, beside)[0] == pytest.approx(5.0)
