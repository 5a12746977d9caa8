"""Robots given by a link table (DH) or by their joints' axes (POE), each as a row of elementary motions.

Every geometric parameter is the value of one such motion: its derivative is a unit screw, fixed in that frame.

After Okamura and Park, Robotica 14 (1996) 415. Here with the least number of parameters: a joint has four small
motions, those of a line, in its own frame. Parallel axes are no special case. With base and tool, 4n + 6 combinations
of the parameters are observable.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NamedTuple, Self, TypeAlias, final, get_args

import numpy as np
from numpy.typing import ArrayLike

from cellctl.kinematics._frames import Bools, Floats, inverse_pose, pose


class Motion(NamedTuple):
    """A turn (rad) or slide (mm) by `value` about or along axis 0, 1 or 2 (x, y, z); `name` where it is a parameter."""

    name: str | None
    turns: bool
    axis: int
    value: float


Segment: TypeAlias = tuple[Floats, list[Motion]]
"""The part between two joints: a fixed pose (4, 4), then motions."""


_IDENTITY = np.eye(4)


def motion_matrix(motion: Motion) -> Floats:
    """The 4×4 transform of one elementary motion."""
    result = _IDENTITY.copy()
    if not motion.turns:
        result[motion.axis, 3] = motion.value
        return result
    i, j = (motion.axis + 1) % 3, (motion.axis + 2) % 3
    cosine, sine = math.cos(motion.value), math.sin(motion.value)
    result[i, i] = result[j, j] = cosine
    result[i, j], result[j, i] = -sine, sine
    return result


def segment_matrix(segment: Segment) -> Floats:
    """The 4×4 transform of a whole segment."""
    matrix, motions = segment
    for motion in motions:
        if motion.value:
            matrix = matrix @ motion_matrix(motion)
    return matrix


def frame_motions(frame: str) -> Iterator[Motion]:
    """The six small motions, all zero, by which frame `base` or `tool` may differ from its stated pose."""
    for axis, letter in enumerate("xyz"):
        yield Motion(f"{frame}_{letter}", False, axis, 0.0)
    for axis, letter in ((2, "a"), (1, "b"), (0, "c")):
        yield Motion(f"{frame}_{letter}", True, axis, 0.0)


TableConvention: TypeAlias = Literal["mdh-hayati", "dh-craig"]
"""How a row of a link table becomes a transform: see `Link`."""

TABLE_CONVENTIONS: tuple[str, ...] = get_args(TableConvention)


@final
@dataclass(frozen=True, slots=True)
class Link:
    """One row of a link table; angles in rad, lengths in mm.

    mdh-hayati: T = Rz(joint + theta) Tz(d) Tx(a) Rx(alpha) Ry(beta), the joint first.
    dh-craig: T = Rx(alpha) Tx(a) Ry(beta) Rz(joint + theta) Tz(d), the joint last.
    Where `beta` is given (axes near parallel), `d` is a constant and not a parameter: the two are not separable.
    prismatic: the joint adds to d, not to theta: d is its zero, and always a parameter.
    """

    theta: float = 0.0
    d: float = 0.0
    a: float = 0.0
    alpha: float = 0.0
    beta: float | None = None
    prismatic: bool = False


@final
@dataclass(frozen=True)
class LinkTable:
    """The rows of a link table, and how to read them. Parameters: theta1, d1, a1, alpha1, beta1, …."""

    convention: TableConvention
    links: tuple[Link, ...]

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.links)

    @cached_property
    def prismatic(self) -> Bools:
        """Which joints (n,) are prismatic."""
        return np.array([link.prismatic for link in self.links], bool)

    @cached_property
    def slides(self) -> tuple[int, ...]:
        """The prismatic joints, from 0."""
        return tuple(np.flatnonzero(self.prismatic).tolist())

    @cached_property
    def segments(self) -> list[Segment]:
        """The parts between the joints: n + 1 segments, the first before joint 1, the last from joint n to the flange.

        From the second on, a segment begins in the frame behind its joint.
        """
        segments: list[list[Motion]] = [[] for _ in range(self.n + 1)]
        for index, link in enumerate(self.links):
            theta, d, a, alpha, *beta = _link_motions(link, index + 1)
            if self.convention == "mdh-hayati":
                segments[index + 1] += [theta, d, a, alpha, *beta]
            else:
                segments[index] += [alpha, a, *beta]
                segments[index + 1] += [theta, d]
        return [(np.eye(4), motions) for motions in segments]


def _link_motions(link: Link, number: int) -> list[Motion]:
    parallel = link.beta is not None
    return [
        Motion(f"theta{number}", True, 2, link.theta),
        Motion(None if parallel and not link.prismatic else f"d{number}", False, 2, link.d),
        Motion(f"a{number}", False, 0, link.a),
        Motion(f"alpha{number}", True, 0, link.alpha),
        *([] if link.beta is None else [Motion(f"beta{number}", True, 1, link.beta)]),
    ]


ACROSS = 0.65
"""A base axis serves as a joint frame's x where its cosine with the joint is below this (> 1/√3: one always is)."""


@final
@dataclass(frozen=True, eq=False)
class JointAxis:
    """A joint's axis at model zero, in the robot's base frame: direction (3,) of length 1, a point (3,) on it, mm.

    Of a prismatic joint only the direction has an effect; the point is the origin of the joint's frame.
    """

    direction: Floats
    point: Floats
    prismatic: bool = False

    @classmethod
    def through(cls, point: ArrayLike, direction: ArrayLike, *, prismatic: bool = False) -> Self:
        """The axis along `direction` (3,), of any length but 0, through `point` (3,), mm. Raises ValueError."""
        along, place = np.array(direction, float), np.array(point, float)
        if along.shape != (3,) or place.shape != (3,) or not (np.isfinite(along).all() and np.isfinite(place).all()):
            raise ValueError("a joint's axis is three numbers, and so is a point on it")
        largest = float(np.abs(along).max())
        if largest == 0.0:
            raise ValueError("a joint's axis has no direction: its length is 0")
        along /= largest  # so that no square underflows or overflows
        return cls(along / np.linalg.norm(along), place, prismatic)

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
    behind it and the tool: it serves to find joint zeros where the axes are held. A prismatic joint has turn_xi and
    turn_yi; its zero is di, a slide along the joint itself; another place of its axis changes nothing.
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

    @cached_property
    def prismatic(self) -> Bools:
        """Which joints (n,) are prismatic."""
        return np.array([axis.prismatic for axis in self.axes], bool)

    @cached_property
    def slides(self) -> tuple[int, ...]:
        """The prismatic joints, from 0."""
        return tuple(np.flatnonzero(self.prismatic).tolist())

    @cached_property
    def segments(self) -> list[Segment]:
        """The parts between the joints: n + 1 segments, the first before joint 1, the last up to the flange."""
        frames = [np.eye(4), *(axis.frame() for axis in self.axes), self.home]
        steps = [inverse_pose(before) @ behind for before, behind in itertools.pairwise(frames)]
        motions = [_axis_motions(number, axis.prismatic) for number, axis in enumerate(self.axes, 1)]
        return [*zip(steps[:-1], motions, strict=True), (steps[-1], [])]


def _axis_motions(number: int, prismatic: bool) -> list[Motion]:
    turns = [Motion(f"turn_x{number}", True, 0, 0.0), Motion(f"turn_y{number}", True, 1, 0.0)]
    if prismatic:
        return [*turns, Motion(f"d{number}", False, 2, 0.0)]
    return [
        *turns,
        Motion(f"slide_x{number}", False, 0, 0.0),
        Motion(f"slide_y{number}", False, 1, 0.0),
        Motion(f"theta{number}", True, 2, 0.0),
    ]
