"""ISO 9283 figures: a hand-worked example, and an independent computation with the standard library."""

from __future__ import annotations

import math
import statistics

import numpy as np
import pytest

from cellctl.metrology.iso9283 import (
    cube_points,
    distance_figures,
    multi_direction,
    performance,
    pose_figures,
)


def test_a_hand_worked_example_of_accuracy_and_repeatability():
    """Four cycles around (1, 2, 2) off the command: at 3, 1, 1, 1 mm from the mean along x; AP = 3.

    x: 1 + (3, −1, −1, −1): mean 1. l = 3, 1, 1, 1: l̄ = 1.5, S_l = √((1.5² + 3 · 0.5²) / 3) = 1; RP_l = 4.5.
    a: 0.1 + (0.3, −0.1, −0.1, −0.1): S_a = √((0.09 + 0.03) / 3) = 0.2; RP_a = ± 0.6.
    """
    command = [100.0, 200.0, 300.0, 10.0, 20.0, 30.0]
    off = [[4.0, 2.0, 2.0, 0.4, 0.0, 0.0], *[[0.0, 2.0, 2.0, 0.0, 0.0, 0.0]] * 3]
    found = pose_figures(np.array(command) + off, command)
    assert found.accuracy == pytest.approx(3.0)
    assert np.allclose(found.of_axes, [1.0, 2.0, 2.0])
    assert found.repeatability == pytest.approx(4.5)
    assert np.allclose(found.of_angles, [0.1, 0.0, 0.0])
    assert np.allclose(found.angle_repeatability, [0.6, 0.0, 0.0])


def test_a_hand_worked_distance():
    """D = 100.2, 100.0, 99.8, command 99.9: AD = 0.1, S_D = 0.2, RD = ± 0.6."""
    first = np.array([[100.2, 0.0, 0.0], [0.0, 100.0, 0.0], [0.0, 0.0, 99.8]])
    found = distance_figures(first, np.zeros((3, 3)), 99.9)
    assert found.accuracy == pytest.approx(0.1)
    assert found.repeatability == pytest.approx(0.6)


def test_a_hand_worked_variation_over_three_directions():
    """Means at (0, 0, 0), (3, 4, 0), (0, 0, 1): the largest distance is √26, between the second and the third."""
    means = np.array([[0.0, 0, 0, 0, 0, 0], [3.0, 4.0, 0, 0.5, 0, 0], [0, 0, 1.0, 0, 0, 0]])
    poses = np.stack([means + 0.1, means - 0.1])
    found = multi_direction(poses)
    assert found.position == pytest.approx(math.sqrt(26.0))
    assert np.allclose(found.angles, [0.5, 0.0, 0.0])


def test_all_figures_agree_with_an_independent_computation():
    rng = np.random.default_rng(1)
    commands = rng.uniform(-500, 500, (5, 6))
    attained = commands + rng.normal(0.2, 0.05, (30, 5, 6))
    varied = rng.normal(0.0, 0.1, (30, 3, 3, 6))
    found = performance(attained, commands, varied)
    for point in range(5):
        columns = [[float(cycle[point][axis]) for cycle in attained] for axis in range(6)]
        mean = [statistics.fmean(column) for column in columns]
        radii = [math.dist(place, mean[:3]) for place in zip(*columns[:3], strict=True)]
        figures = found.points[point]
        assert figures.accuracy == pytest.approx(math.dist(mean[:3], commands[point][:3]))
        assert figures.repeatability == pytest.approx(statistics.fmean(radii) + 3 * statistics.stdev(radii))
        spread = [3 * statistics.stdev(column) for column in columns[3:]]
        assert figures.angle_repeatability.tolist() == pytest.approx(spread)
    distances = [math.dist(cycle[1][:3], cycle[3][:3]) for cycle in attained]
    wanted = math.dist(commands[1][:3], commands[3][:3])
    assert found.distance.accuracy == pytest.approx(statistics.fmean(distances) - wanted)
    assert found.distance.repeatability == pytest.approx(3 * statistics.stdev(distances))
    for point in range(3):
        means = [
            [statistics.fmean(cycle[way][point][axis] for cycle in varied) for axis in range(3)] for way in range(3)
        ]
        largest = max(math.dist(one, other) for one in means for other in means)
        assert found.directions[point].position == pytest.approx(largest)
    assert found.complete


def test_angles_are_compared_across_180_degrees():
    command = [0.0, 0.0, 0.0, 179.9, 0.0, -180.0]
    found = pose_figures([[0, 0, 0, -179.9, 0, 179.8], [0, 0, 0, 180.1, 0, 179.8]], command)
    assert np.allclose(found.of_angles, [0.2, 0.0, -0.2])


def test_the_five_points_lie_in_one_plane_on_its_diagonals_a_tenth_from_their_ends():
    points = cube_points([1000.0, -200.0, 100.0], 400.0)
    corners = [[1000, -200, 100], [1000, 200, 100], [1400, 200, 500], [1400, -200, 500]]
    assert np.allclose(points[0], np.mean(corners, axis=0))
    for corner, point in zip(corners, points[1:], strict=True):
        assert math.dist(corner, point) == pytest.approx(0.1 * math.dist(corners[0], corners[2]))
    assert np.linalg.matrix_rank(points - points[0], tol=1e-6) == 2
    assert np.allclose((points[1] + points[3]) / 2, points[0])
    with pytest.raises(ValueError, match="10 ± 2"):
        cube_points([0, 0, 0], 100.0, 0.2)


def test_missing_values_and_single_cycles_are_refused():
    with pytest.raises(ValueError, match="two cycles"):
        pose_figures(np.zeros((1, 6)), np.zeros(6))
    with pytest.raises(ValueError, match="measure the missing"):
        performance(np.full((30, 5, 6), np.nan), np.zeros((5, 6)))
