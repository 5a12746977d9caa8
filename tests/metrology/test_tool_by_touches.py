"""The tool centre point from touches on a sphere and from poses at a point, and its σ."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cellctl.metrology.four_point import tips, tool_at_point, tool_by_touches, touch_residuals

TOOL, CENTRE, REACH = np.array([60.0, 50.0, 410.0]), np.array([950.0, -350.0, 250.0]), 31.3
NOISE_MM = 0.02


def orientations(random: np.random.Generator, count: int) -> np.ndarray:
    """Flange rotations (count, 3, 3): up to about 70° from straight down, any spin."""
    tilted = Rotation.from_rotvec(random.uniform(-0.9, 0.9, (count, 3))) * Rotation.from_euler("x", np.pi)
    return tilted.as_matrix()


def touches(random: np.random.Generator, count: int, each: int, noise: float, common: float):
    """Flange poses of touches, `each` with each of `count` orientations, and the orientation of each touch."""
    group = np.repeat(np.arange(count), each)
    normals = random.normal(size=(len(group), 3))
    normals[:, 2] = np.abs(normals[:, 2])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    flanges = np.tile(np.eye(4), (len(group), 1, 1))
    flanges[:, :3, :3] = orientations(random, count)[group]
    at = CENTRE + normals * (REACH + random.normal(0.0, noise, (len(group), 1)))
    errors = random.normal(0.0, common, (count, 3))[group]
    flanges[:, :3, 3] = at + errors - flanges[:, :3, :3] @ TOOL
    return flanges, np.full(len(group), REACH), group


def test_touches_without_errors_give_tool_and_centre_exactly() -> None:
    flanges, reach, group = touches(np.random.default_rng(1), 4, 4, 0.0, 0.0)
    found = tool_by_touches(flanges, reach, group, TOOL + np.array([3.0, -2.0, 4.0]), NOISE_MM)
    assert found.tool == pytest.approx(TOOL, abs=1e-6)
    assert found.point == pytest.approx(CENTRE, abs=1e-6)
    assert touch_residuals(flanges, reach, found.tool, found.point) == pytest.approx(0.0, abs=1e-6)


# 3 for known sizes of the errors. Noise alone: less, for neither size is ever found below the stated one. An error of
# each orientation: more, for its size is estimated from 8 orientations.
@pytest.mark.long
@pytest.mark.parametrize(
    ("common", "low", "high"), [(0.0, 1.7, 3.3), (0.8, 2.5, 4.6)], ids=["noise alone", "an error of each orientation"]
)
def test_sigma_of_the_tool_is_what_its_errors_are(common: float, low: float, high: float) -> None:
    random = np.random.default_rng(2)
    squares = []
    for _ in range(60):
        flanges, reach, group = touches(random, 8, 4, NOISE_MM, common)
        found = tool_by_touches(flanges, reach, group, TOOL + 1.0, NOISE_MM)
        off = found.tool - TOOL
        squares.append(float(off @ np.linalg.solve(found.covariance[:3, :3], off)))
    assert low < np.mean(squares) < high


def test_the_scatter_of_contacts_and_of_orientations_are_told_apart() -> None:
    flanges, reach, group = touches(np.random.default_rng(3), 20, 5, 0.05, 0.8)
    found = tool_by_touches(flanges, reach, group, TOOL, NOISE_MM)
    assert found.sigma_mm == pytest.approx(0.05, rel=0.3)
    assert found.common_mm == pytest.approx(0.8, rel=0.3)


def test_poses_at_a_point_give_tool_and_point_with_sigma() -> None:
    random = np.random.default_rng(4)
    squares = []
    for _ in range(60):
        flanges = np.tile(np.eye(4), (8, 1, 1))
        flanges[:, :3, :3] = orientations(random, 8)
        flanges[:, :3, 3] = CENTRE + random.normal(0.0, 0.5, (8, 3)) - flanges[:, :3, :3] @ TOOL
        found = tool_at_point(flanges, NOISE_MM)
        off = found.tool - TOOL
        squares.append(float(off @ np.linalg.solve(found.covariance[:3, :3], off)))
    assert 2.2 < np.mean(squares) < 4.6
    assert tips(flanges, found.tool) == pytest.approx(np.tile(found.point, (8, 1)), abs=2.0)


def test_three_orientations_are_refused() -> None:
    flanges, reach, group = touches(np.random.default_rng(5), 3, 5, 0.0, 0.0)
    with pytest.raises(ValueError, match="3 tool orientations do not determine a tool: 4 at least"):
        tool_by_touches(flanges, reach, group, TOOL, NOISE_MM)


def test_orientations_that_turn_about_one_axis_are_refused() -> None:
    flanges = np.tile(np.eye(4), (6, 1, 1))
    flanges[:, :3, :3] = Rotation.from_euler("z", np.linspace(0, 300, 6)[:, None], degrees=True).as_matrix()
    flanges[:, :3, 3] = CENTRE - flanges[:, :3, :3] @ TOOL
    with pytest.raises(ValueError, match="turn about one axis only"):
        tool_at_point(flanges, NOISE_MM)
