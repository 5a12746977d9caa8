"""The paths between taught points as a controller interpolates them: a straight line or a circle, orientation on the
great arc.

KUKA's LIN and CIRC with orientation #VAR, relative to the base (KSS, operating and programming instructions for system
integrators, "motion types"): the orientation turns about one axis from start to end, in proportion to the way. The
orientation of an auxiliary point is not used.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Self, TypeAlias, final

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from cellctl.kinematics import Floats, pose, rotation_vector

_ALIKE_MM = 0.01
"""Points nearer to each other, or to one line, give no circle."""


@final
@dataclass(frozen=True, eq=False)
class Line:
    """LIN: a straight line from pose `start` (4, 4) to pose `end`, mm."""

    start: Floats
    end: Floats

    def poses(self, shares: ArrayLike) -> Floats:
        """Poses (M, 4, 4), mm, at shares (M,) of the way."""
        share = np.asarray(shares, float)
        places = self.start[:3, 3] + share[:, None] * (self.end[:3, 3] - self.start[:3, 3])
        return pose(_turned(self.start, self.end, share), places)

    def piece(self, first: float, last: float) -> Line:
        """The part between two shares."""
        return Line(*self.poses([first, last]))

    def through(self, poses: Floats) -> Line:
        """The line from the first of `poses` (M, 4, 4) to the last."""
        return Line(poses[0], poses[-1])

    @property
    def finish(self) -> Floats:
        """Pose at the end of the way (4, 4), mm."""
        return self.end


@final
@dataclass(frozen=True, eq=False)
class Arc:
    """CIRC: from pose `start` (4, 4) through `auxiliary` (3,), mm, to the place of pose `end`.

    angle: the circular angle (CA), rad, positive in the sense start, auxiliary, end: the way ends there on the circle,
    with the orientation of `end`. None: the way ends at `end`. Made by `Arc.of`, which checks the three points.
    """

    start: Floats
    auxiliary: Floats
    end: Floats
    angle: float | None = None

    @classmethod
    def of(cls, start: Floats, auxiliary: Floats, end: Floats, angle: float | None = None) -> Self:
        """Raises ValueError where the three points determine no circle."""
        made = cls(start, auxiliary, end, angle)
        sides = np.array([start[:3, 3] - auxiliary, auxiliary - end[:3, 3], end[:3, 3] - start[:3, 3]])
        longest = float(np.linalg.norm(sides, axis=1).max())
        height = float(np.linalg.norm(np.cross(sides[0], sides[1]))) / max(longest, 1e-9)
        if height < _ALIKE_MM or np.linalg.norm(sides, axis=1).min() < _ALIKE_MM:
            raise ValueError("start, auxiliary and end point determine no circle")
        return made

    @property
    def total(self) -> float:
        """Angle of the whole way, rad."""
        return self._angle_of(self.end[:3, 3]) if self.angle is None else self.angle

    @property
    def shares(self) -> tuple[float, float]:
        """Shares of the way at which `auxiliary` and the place of `end` lie; above 1: not reached."""
        of_each = (self._angle_of(place) / self.total for place in (self.auxiliary, self.end[:3, 3]))
        auxiliary, end = of_each
        return auxiliary, end

    def poses(self, shares: ArrayLike) -> Floats:
        """Poses (M, 4, 4), mm, at shares (M,) of the way."""
        share = np.asarray(shares, float)
        centre, across, along = self._circle
        angles = share[:, None] * self.total
        places = centre + np.cos(angles) * across + np.sin(angles) * along
        return pose(_turned(self.start, self.end, share), places)

    def piece(self, first: float, last: float) -> Arc:
        """The part between two shares: an arc of the same circle, its auxiliary point half-way."""
        start, middle, end = self.poses([first, (first + last) / 2.0, last])
        return Arc.of(start, middle[:3, 3], end)

    def through(self, poses: Floats) -> Arc:
        """The arc from the first of `poses` (M, 4, 4) through the middle one to the last."""
        return Arc.of(poses[0], poses[len(poses) // 2][:3, 3], poses[-1])

    @property
    def finish(self) -> Floats:
        """Pose at the end of the way (4, 4), mm."""
        return np.asarray(self.poses([1.0])[0])

    @cached_property
    def _circle(self) -> tuple[Floats, Floats, Floats]:
        """Centre (3,), and the radius vectors (3,) to the start and a quarter of a turn further, mm."""
        start, end = self.start[:3, 3], self.end[:3, 3]
        first, second = self.auxiliary - start, end - start
        normal = np.cross(first, second)
        square = float(normal @ normal)
        towards = np.cross(first @ first * second - second @ second * first, normal) / (2.0 * square)
        across = -towards
        return start + towards, across, np.cross(normal / np.sqrt(square), across)

    def _angle_of(self, place: Floats) -> float:
        centre, across, along = self._circle
        return float(np.arctan2((place - centre) @ along, (place - centre) @ across) % (2.0 * np.pi))


Segment: TypeAlias = Line | Arc
"""The way from one taught point to the next."""


def _turned(start: Floats, end: Floats, share: Floats) -> Floats:
    """Orientations (M, 3, 3) on the great arc from pose `start` to pose `end`."""
    whole = rotation_vector(end[:3, :3] @ start[:3, :3].T)
    return np.asarray(Rotation.from_rotvec(share[:, None] * whole).as_matrix() @ start[:3, :3])
