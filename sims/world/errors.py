"""The errors of this robot: drawn once from its seed, each kind from a separate generator.

A generator per kind, so that switching one kind off leaves the others as they were. Sizes: Wang et al. 2024,
doi 10.3390/app14219824, table 3, as standard deviations.
"""

from __future__ import annotations

import zlib

import numpy as np
from numpy.typing import NDArray

from sims.world.kinematics import Axis, Geometry, Vector, turn, vector

AXIS_PLACE_MM = 0.6
AXIS_DIRECTION_DEG = 0.035
FLANGE_PLACE_MM = 0.3
FLANGE_DIRECTION_DEG = 0.02
JOINT_ZERO_DEG = 0.03
TOOL_MM = 1.5


def generator(seed: int, kind: str) -> np.random.Generator:
    """The random numbers of one kind of error of the robot `seed`."""
    return np.random.default_rng([seed, zlib.crc32(kind.encode())])


def true_geometry(nominal: Geometry, seed: int, scale: float) -> Geometry:
    """Axes moved across and tilted, flange moved and turned, each by its standard deviation times `scale`."""
    random = generator(seed, "geometry")
    axes = tuple(_moved_axis(axis, random, scale) for axis in nominal.axes)
    flange = nominal.flange.copy()
    flange[:3, 3] += scale * random.normal(0.0, FLANGE_PLACE_MM, 3)
    flange[:3, :3] = turn(scale * random.normal(0.0, FLANGE_DIRECTION_DEG, 3)) @ flange[:3, :3]
    return Geometry(axes, flange)


def joint_zero_errors(joints: int, seed: int, scale: float) -> list[float]:
    """Degrees, one per joint, in the model's sense of rotation."""
    return [float(error) for error in scale * generator(seed, "joint_zero").normal(0.0, JOINT_ZERO_DEG, joints)]


def tool_error(seed: int, scale: float) -> Vector:
    """From the taught to the true TCP, in the flange frame, mm: its length is 1.5 × `scale`."""
    return vector(scale * TOOL_MM * unit_vector(generator(seed, "tool")))


def unit_vector(random: np.random.Generator) -> NDArray[np.float64]:
    """A direction, even over the sphere."""
    normal = random.normal(size=3)
    return np.asarray(normal / np.linalg.norm(normal), dtype=float)


def _moved_axis(axis: Axis, random: np.random.Generator, scale: float) -> Axis:
    across_1, across_2 = _across(np.array(axis.direction))
    shift_1, shift_2 = scale * random.normal(0.0, AXIS_PLACE_MM, 2)
    tilt_1, tilt_2 = scale * random.normal(0.0, AXIS_DIRECTION_DEG, 2)
    return Axis(
        point=vector(np.array(axis.point) + shift_1 * across_1 + shift_2 * across_2),
        direction=vector(turn(tilt_1 * across_1 + tilt_2 * across_2) @ np.array(axis.direction)),
    )


def _across(direction: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    smallest = np.eye(3)[np.argmin(np.abs(direction))]
    first = np.cross(direction, smallest)
    first /= np.linalg.norm(first)
    return first, np.cross(direction, first)
