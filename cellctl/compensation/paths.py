"""Paths between taught points, how far the identified robot leaves them, and points in between.

KUKA's LIN and CIRC with orientation #VAR, relative to the base (KSS, operating and programming instructions for system
integrators, "motion types"): the orientation turns about one axis from start to end, in proportion to the way. The
orientation of an auxiliary point is not used.

A controller goes from one compensated point to the next on a line or circle of its own nominal kinematics. At the
points the robot is right. In between its errors are others than at the ends, and only the ends are corrected.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Self, TypeAlias, final

import numpy as np
from numpy.typing import ArrayLike

from cellctl.calibration import RobotModel
from cellctl.compensation._compensating import Compensated, compensate
from cellctl.kinematics import Bools, Floats, SerialChain, inverse, pose, rotation_vector

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
    from scipy.spatial.transform import Rotation  # at first use: it takes 0.2 s

    whole = rotation_vector(end[:3, :3] @ start[:3, :3].T)
    return np.asarray(Rotation.from_rotvec(share[:, None] * whole).as_matrix() @ start[:3, :3])


SINGULAR = 0.01
"""Least singular value of the Jacobian, lengths in units of the reach: below it a posture is singular. At the wrist
this is about 2° of A5."""

_FIRST, _MOST = 32, 1024
"""Intervals into which a segment is divided at first, and at most."""

_CLOSE, _CLOSE_MM = 0.05, 0.001
"""The bound is close to the largest sample: by this share, or within this."""

_SAFETY = 2.0
"""By how much the second derivative between samples may exceed the largest second difference."""

_PIECES = 32
"""Parts of one segment at most."""

_JUMP = np.deg2rad(30.0)
"""A joint that moves more from one sample to the next has left its configuration."""


@final
@dataclass(frozen=True, eq=False)
class Way:
    """A controller's joints along S segments at M shares of the way.

    q (S, M, n): model angles, rad; after the last one followed its repetition. followed (S, M): reached, in the
    configuration of the start. singular (S,): `least_singular` on the way.
    """

    q: Floats
    followed: Bools
    singular: Floats


@final
@dataclass(frozen=True, eq=False)
class Deviations:
    """Distance of the identified robot's TCP from S wanted segments, at the same share of the way, mm.

    sampled_mm (S,): largest of the samples. bound_mm (S,): upper bound on the whole way. share (S,): where the largest
    sample is. low, high (S, n): least and greatest model angles on the way, rad. followed (S,): the controller reaches
    the whole way in one configuration; otherwise the other numbers mean nothing. singular (S,): as in `Way`.
    """

    sampled_mm: Floats
    bound_mm: Floats
    share: Floats
    low: Floats
    high: Floats
    followed: Bools
    singular: Floats


@final
@dataclass(frozen=True, eq=False)
class Between:
    """A segment in parts, each of them sent to its own compensated points.

    shares (K + 1,): of the wanted way, 0 and 1 included; K − 1 points are new. sent (K): the parts that the controller
    takes. bound_mm (K,): of each. q (K + 1, n): compensated model angles at the shares, rad. reached: every bound is
    within the tolerance. reason: why not, else empty.
    """

    shares: Floats
    sent: tuple[Segment, ...]
    bound_mm: Floats
    q: Floats
    reason: str

    @property
    def reached(self) -> bool:
        """Whether every part is within the tolerance."""
        return not self.reason


def follow(chain: SerialChain, segments: Sequence[Segment], start: Floats, intervals: int) -> Way:
    """Joints of a controller with `chain` along `segments` (S), from postures near `start` (S, n), rad.

    Solved share by share, each from the one before, at intervals + 1 shares.
    """
    shares = np.linspace(0.0, 1.0, intervals + 1)
    poses = np.stack([segment.poses(shares) for segment in segments], axis=1)
    q, followed = np.tile(np.array(start, float), (len(shares), 1, 1)), np.zeros((len(shares), len(start)), bool)
    going = np.arange(len(start))
    for place, goal in enumerate(poses):
        last = q[max(place - 1, 0), going]
        found = inverse(chain, goal[going], last, tolerance_mm=1e-7, tolerance_rad=1e-10)
        near = found.converged & (np.abs(found.q - last).max(axis=1) < _JUMP)
        q[place:, going], followed[place, going] = found.q, near
        going = going[near]
    return Way(q.swapaxes(0, 1), followed.T, least_singular(chain, q).min(axis=0))


def deviations(
    nominal: SerialChain,
    identified: RobotModel,
    wanted: Sequence[Segment],
    sent: Sequence[Segment],
    start: Floats,
) -> Deviations:
    """How far the identified robot leaves `wanted` (S) when a controller with `nominal` is sent along `sent` (S).

    start (S, n): model angles near the first point of each, rad. Compared at the same share of the way.

    Bound: between two samples at distance h the error vector e is within h²/8 max|e″| of the straight line between
    them. max|e″| is taken as twice the largest second difference of the samples. Samples are doubled until the bound is
    close to the largest sample; a segment with errors that change within 1/1000 of its length has a bound that may be
    too small. Effects of conditions that a program does not state (approach, temperature, payload, motor current) are
    left out.
    """
    found, intervals = _sampled(nominal, identified, wanted, sent, start, _FIRST), _FIRST
    open_rows = list(range(len(wanted)))
    while (open_rows := [row for row in open_rows if _loose(found, row)]) and intervals < _MOST:
        intervals *= 2
        parts = [wanted[row] for row in open_rows], [sent[row] for row in open_rows]
        _put(found, open_rows, _sampled(nominal, identified, *parts, start[open_rows], intervals))
    return found


def divided(
    nominal: SerialChain,
    identified: RobotModel,
    wanted: Segment,
    start: Floats,
    *,
    tolerance_mm: float,
    method: str = "pseudo-target",
) -> Between:
    """`wanted` in as few parts, by halves, as keep the bound of the deviation within `tolerance_mm`.

    start (n,): model angles near its first point, rad. Every part goes between points that are compensated themselves;
    a part of a circle has a compensated auxiliary point.
    """
    fine = np.linspace(0.0, 1.0, 2 * _PIECES + 1)
    way = follow(nominal, [wanted], start[None], len(fine) - 1)
    if not way.followed.all():
        return Between(fine[:0], (), fine[:0], way.q[0, :0], "the path cannot be followed")
    points = joints_for(nominal, identified, wanted.poses(fine), way.q[0], method=method)
    if not points.converged.all():
        return Between(fine[:0], (), fine[:0], way.q[0, :0], "a point on the path cannot be compensated")
    pseudo = nominal.forward(points.compensated_q)
    parts, undecided = dict[tuple[int, int], tuple[Segment, float]](), [(0, len(fine) - 1)]
    while undecided:
        pieces = [wanted.piece(fine[first], fine[last]) for first, last in undecided]
        sent = [wanted.through(pseudo[[first, (first + last) // 2, last]]) for first, last in undecided]
        bounds = deviations(
            nominal, identified, pieces, sent, points.compensated_q[[at for at, _ in undecided]]
        ).bound_mm
        parts |= dict(zip(undecided, zip(sent, bounds.tolist(), strict=True), strict=True))
        coarse = [ends for ends in undecided if not parts[ends][1] <= tolerance_mm and ends[1] - ends[0] > 2]
        undecided = []
        for first, last in coarse:
            del parts[first, last]
            undecided += [(first, (first + last) // 2), ((first + last) // 2, last)]
    order = sorted(parts)
    at = [first for first, _ in order] + [len(fine) - 1]
    bound = np.array([parts[ends][1] for ends in order])
    reason = "" if (bound <= tolerance_mm).all() else f"{_PIECES} parts are too few"
    return Between(fine[at], tuple(parts[ends][0] for ends in order), bound, points.compensated_q[at], reason)


def _loose(found: Deviations, row: int) -> bool:
    """Whether more samples would bring the bound of a row closer to its largest sample."""
    most = max(_CLOSE * found.sampled_mm[row], _CLOSE_MM)
    return bool(found.followed[row] and found.bound_mm[row] - found.sampled_mm[row] > most)


def _put(found: Deviations, rows: list[int], finer: Deviations) -> None:
    for mine, theirs in zip(vars(found).values(), vars(finer).values(), strict=True):
        mine[rows] = theirs


def joints_for(
    nominal: SerialChain, identified: RobotModel, targets: Floats, start: Floats, *, method: str = "pseudo-target"
) -> Compensated:
    """`compensate` for a controller whose tool data differ from the tool that the identified robot counts from.

    Only the compensated joints are meant: they do not depend on the controller's tool data.
    """
    return compensate(nominal.with_tool(identified.chain.tool), identified, targets, start, method=method)


def posture_at(chain: SerialChain, segment: Segment, start: Floats, share: float) -> Floats | None:
    """Model angles (n,), rad, in which a controller arrives at `share` of a segment from posture `start` (n,), rad.

    The share may be beyond the end of a circle. None where the way cannot be followed.
    """
    q = start
    for goal in segment.poses(np.linspace(0.0, share, _steps(segment, share) + 1)):
        found = inverse(chain, goal, q, tolerance_mm=1e-7, tolerance_rad=1e-10)
        if not found.converged or np.abs(found.q - q).max() > _JUMP:
            return None
        q = found.q
    return q


def least_singular(chain: SerialChain, q: Floats) -> Floats:
    """Least singular value (...) of the Jacobian at q (..., n), rad, lengths in units of the reach."""
    jacobian = chain.tool_jacobian(q)
    jacobian[..., :3, :] /= max(chain.reach_mm, 1.0)
    return np.asarray(np.linalg.svd(jacobian, compute_uv=False)[..., -1])


def _steps(segment: Segment, share: float) -> int:
    """Steps of about 50 mm and 10°, at least two, at most as many as samples of a path."""
    poses = segment.poses(np.linspace(0.0, share, 9))
    way = float(np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1).sum())
    turn = float(np.rad2deg(np.linalg.norm(rotation_vector(poses[1, :3, :3] @ poses[0, :3, :3].T)))) * 8.0
    return int(np.clip(max(way / 50.0, turn / 10.0), 2, _FIRST))


def _sampled(
    nominal: SerialChain,
    identified: RobotModel,
    wanted: Sequence[Segment],
    sent: Sequence[Segment],
    start: Floats,
    intervals: int,
) -> Deviations:
    way = follow(nominal, sent, start, intervals)
    shares = np.linspace(0.0, 1.0, intervals + 1)
    places = np.stack([segment.poses(shares)[:, :3, 3] for segment in wanted])
    error = identified.tcp(way.q) - places
    size = np.linalg.norm(error, axis=-1)
    bend = np.linalg.norm(np.diff(error, 2, axis=1), axis=-1).max(axis=1)
    return Deviations(
        size.max(axis=1),
        size.max(axis=1) + _SAFETY / 8.0 * bend,
        shares[np.argmax(size, axis=1)],
        way.q.min(axis=1),
        way.q.max(axis=1),
        np.asarray(way.followed.all(axis=1)),
        way.singular,
    )
