"""What the scene tells a device's simulator that has no robot controller: where the tool is, and what is in the way."""

from math import dist

import pytest

from sims.bench import catalogue
from sims.cell import Plate
from sims.faults import Faults
from sims.scene.scene import Scene
from tests.helpers.sims import with_errors


@pytest.fixture
def scene(kernel):
    """The shipped cell without errors."""
    cell = with_errors()
    assert cell.artefact.plate == Plate(100.0, 8.0)
    return Scene(kernel, cell, Faults(kernel, catalogue()))


def across(place, way=(0.0, 100.0, 0.0)):
    """A line through a place."""
    return tuple(a - b for a, b in zip(place, way, strict=True)), tuple(a + b for a, b in zip(place, way, strict=True))


def test_the_tool_is_where_the_world_says_also_on_its_way(scene):
    kernel, target = scene.arm._kernel, (10.0, -90.0, 90.0, 0.0, 45.0, 0.0)
    before = scene.tcp()
    scene.arm.move(target, 10.0, lambda: None)
    end = scene.arm._motion.end_ns
    assert scene.tcp(0) == pytest.approx(before)
    assert scene.tcp(end) == pytest.approx(scene.world.true_tcp(target))
    assert 10.0 < dist(scene.tcp(end // 2), before) < dist(scene.tcp(end), before)
    assert kernel.now == 0


@pytest.mark.parametrize(
    ("place", "blocked"),
    [
        ((950.0, -350.0, 250.0), True),  # sphere S1
        ((950.0, -350.0, 250.0 + 30.0), True),
        ((950.0, -350.0, 250.0 + 31.0), False),
        ((950.0, -350.0, 180.0), True),  # its stem
        ((957.5, -350.0, 180.0), True),
        ((958.5, -350.0, 180.0), False),
    ],
)
def test_spheres_and_stems_are_in_the_way(scene, place, blocked):
    assert scene.blocked(*across(place)) is blocked


@pytest.mark.parametrize(("x", "blocked"), [(1000.0, True), (1249.0, True), (1251.0, False)])
def test_the_plate_is_in_the_way_as_far_as_it_reaches(scene, x, blocked):
    assert scene.blocked((x, 100.0, 50.0), (x, 100.0, 150.0)) is blocked


def test_the_arm_is_in_the_way_where_it_is_at_that_time(scene):
    _, wrist, flange, _ = scene.world._body(scene.arm.joints())
    line = across(tuple((a + b) / 2.0 for a, b in zip(wrist, flange, strict=True)), (0.0, 300.0, 0.0))
    scene.arm.move((90.0, -90.0, 90.0, 0.0, 45.0, 0.0), 50.0, lambda: None)
    assert scene.blocked(*line, 0)
    assert not scene.blocked(*line, scene.arm._motion.end_ns)


def test_a_line_beside_everything_is_free(scene):
    assert not scene.blocked((2000.0, -2000.0, 1500.0), (2000.0, 2000.0, 1500.0))
