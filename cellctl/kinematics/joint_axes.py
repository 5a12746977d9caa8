"""Robots given by their joints' axes: the product of exponentials, e^[ξ1]q1 … e^[ξn]qn M.

After Okamura and Park, Robotica 14 (1996) 415. Here with the least number of parameters: a joint has four small
motions, those of a line, in its own frame. Parallel axes are no special case. With base and tool, 4n + 6 combinations
of the parameters are observable.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Self, final

import numpy as np
from numpy.typing import ArrayLike

from cellctl.kinematics.arrays import Floats
from cellctl.kinematics.elementary import Motion, Segment
from cellctl.kinematics.frames import inverse_pose, pose

ACROSS = 0.65
"""A base axis serves as a joint frame's x where its cosine with the joint is below this (> 1/√3: one always is)."""


@final
@dataclass(frozen=True, eq=False)
class JointAxis:
    """A joint's axis at model zero, in the robot's base frame: direction (3,) of length 1, a point (3,) on it, mm."""

    direction: Floats
    point: Floats

    @classmethod
    def through(cls, point: ArrayLike, direction: ArrayLike) -> Self:
        """The axis along `direction` (3,), of any length but 0, through `point` (3,), mm. Raises ValueError."""
        along, place = np.array(direction, float), np.array(point, float)
        if along.shape != (3,) or place.shape != (3,) or not (np.isfinite(along).all() and np.isfinite(place).all()):
            raise ValueError("a joint's axis is three numbers, and so is a point on it")
        largest = float(np.abs(along).max())
        if largest == 0.0:
            raise ValueError("a joint's axis has no direction: its length is 0")
        along /= largest  # so that no square underflows or overflows
        return cls(along / np.linalg.norm(along), place)

    def frame(self) -> Floats:
        """The joint's own frame (4, 4): origin at the point, z along the axis.

        x is the base frame's X made perpendicular to z, or its Y (or Z) where X lies within 49° of the axis.
        """
        across = np.eye(3)[np.flatnonzero(np.abs(self.direction) < ACROSS)[0]]
        x = across - (across @ self.direction) * self.direction
        x /= np.linalg.norm(x)
        return pose(np.column_stack([x, np.cross(self.direction, x), self.direction]), self.point)


@final
@dataclass(frozen=True, eq=False)
class AxisTable:
    """The joints' axes and the flange's pose (4, 4), mm, all at model zero in the robot's base frame.

    Parameters of joint i move its axis, and everything behind it: turn_xi, turn_yi about, slide_xi, slide_yi along the
    axes x and y of the joint's own frame; thetai, a turn about the joint itself. Theta is redundant with the axes
    behind it and the tool: it serves to find joint zeros where the axes are held.
    """

    axes: tuple[JointAxis, ...]
    home: Floats

    @classmethod
    def of(cls, axes: Iterable[JointAxis], home: Floats) -> Self:
        """A table of at least one axis. Raises ValueError."""
        joints = tuple(axes)
        if not joints:
            raise ValueError("a chain has at least one joint")
        return cls(joints, home)

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.axes)

    def segments(self) -> list[Segment]:
        """The parts between the joints: n + 1 segments, the first before joint 1, the last up to the flange."""
        frames = [np.eye(4), *(axis.frame() for axis in self.axes), self.home]
        steps = [inverse_pose(before) @ behind for before, behind in itertools.pairwise(frames)]
        return [*((step, _motions(number)) for number, step in enumerate(steps[:-1], 1)), (steps[-1], [])]


def _motions(number: int) -> list[Motion]:
    return [
        Motion(f"turn_x{number}", True, 0, 0.0),
        Motion(f"turn_y{number}", True, 1, 0.0),
        Motion(f"slide_x{number}", False, 0, 0.0),
        Motion(f"slide_y{number}", False, 1, 0.0),
        Motion(f"theta{number}", True, 2, 0.0),
    ]
