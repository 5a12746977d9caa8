"""Serial chains of revolute and prismatic joints: the TCP's pose, and its derivatives by joints and parameters.

Every chain is brought to the form C0 Z(q1) C1 Z(q2) … Z(qn) Cn with constant C, from any table; Z turns about z, or (a
prismatic joint) slides along it. Model coordinates q are SI: rad, and m of a prismatic joint; all lengths are mm. A
parameter is a unit screw at a fixed place in the frame behind the joint before it, so that all columns of a Jacobian
are constants carried by the same n frames. Inside, the batch is the last axis: each number is then one long vector.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal, Self, TypeAlias, final

import numpy as np
from numpy.typing import ArrayLike

from cellctl.kinematics._frames import Bools, Floats
from cellctl.kinematics.geometry import (
    TABLE_CONVENTIONS,
    AxisTable,
    JointAxis,
    Link,
    LinkTable,
    Segment,
    TableConvention,
    frame_motions,
    motion_matrix,
    segment_matrix,
)

Convention: TypeAlias = TableConvention | Literal["poe"]
"""How a robot is described: by one of the link tables, or by the joints' axes with the flange's home pose."""

CONVENTIONS: tuple[str, ...] = (*TABLE_CONVENTIONS, "poe")

MM_PER_M = 1000.0
"""Lengths of a chain are mm, coordinates of its prismatic joints m: numbers of the size of an angle in rad."""

BLOCK = 1024
"""Poses per computation: the frames of this many fit a second-level cache (n = 6: 0.7 MB)."""


@final
@dataclass(frozen=True)
class Screws:
    """The parameters of one segment as unit screws in the frame behind its joint.

    turns (P,): a turn or a slide; direction (P, 4): axis, 0; point (P, 4): a point on the axis, 1.
    """

    turns: Bools
    direction: Floats
    point: Floats


@final
@dataclass(frozen=True, eq=False)
class SerialChain:
    """A robot with n joints, its base in the measuring frame and its tool; immutable. q: rad, of a prismatic joint m.

    table: the robot by its links, or by its joints' axes. base, tool (4, 4): base in the measuring frame, TCP in the
    flange frame, mm. deviations (P,): difference of each of `parameters` from table, base and tool, mm or rad.
    """

    table: LinkTable | AxisTable
    base: Floats = field(default_factory=lambda: np.eye(4))
    tool: Floats = field(default_factory=lambda: np.eye(4))
    deviations: Floats = field(default_factory=lambda: np.zeros(0))

    @classmethod
    def from_links(
        cls,
        convention: TableConvention,
        links: Sequence[Link],
        base: ArrayLike | None = None,
        tool: ArrayLike | None = None,
    ) -> Self:
        """A chain from its link table; base and tool (4, 4) default to none.

        Raises ValueError for an unknown convention, no link, or a base or tool that is not a pose.
        """
        if convention not in TABLE_CONVENTIONS:
            raise ValueError(f"a link table's convention is one of {', '.join(TABLE_CONVENTIONS)}, not '{convention}'")
        if not links:
            raise ValueError("a chain has at least one link")
        table = LinkTable(convention, tuple(links))
        return cls(table, _checked_pose("base", base), _checked_pose("tool", tool))

    @classmethod
    def from_axes(
        cls,
        axes: Sequence[JointAxis],
        home: ArrayLike,
        base: ArrayLike | None = None,
        tool: ArrayLike | None = None,
    ) -> Self:
        """A chain (`poe`) from its joints' axes and the flange's pose `home` (4, 4), mm, all at model zero in the base.

        base and tool (4, 4) default to none. Raises ValueError for no axis, or a home, base or tool that is not a pose.
        """
        table = AxisTable.of(axes, _checked_pose("home", home))
        return cls(table, _checked_pose("base", base), _checked_pose("tool", tool))

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.table.n

    @property
    def prismatic(self) -> Bools:
        """Which joints (n,) slide along their axis; the others turn about it."""
        return self.table.prismatic

    @property
    def convention(self) -> Convention:
        """`mdh-hayati`, `dh-craig` or `poe`."""
        return self.table.convention if isinstance(self.table, LinkTable) else "poe"

    @property
    def reach_mm(self) -> float:
        """Upper bound of the distance from joint 1's frame to the TCP, mm: all links in line."""
        return float(sum(np.linalg.norm(step[:3, 3]) for step in self._constants[1:]))

    @cached_property
    def parameters(self) -> tuple[str, ...]:
        """Names in common terms: base_x…z, base_a…c, those of the table by joint, tool_x…z, tool_a…c.

        A link table has theta1, d1, a1, alpha1, beta1, …; `poe` turn_x1, turn_y1, slide_x1, slide_y1, theta1, …; of a
        prismatic joint turn_x1, turn_y1, d1. The zero of a joint is its theta, or its d if it is prismatic.
        """
        return tuple(motion.name for _, motions in self._nominal for motion in motions if motion.name)

    @cached_property
    def parameter_turns(self) -> Bools:
        """Which parameters (P,) are angles (rad); the others are lengths (mm)."""
        return np.array([motion.turns for _, motions in self._nominal for motion in motions if motion.name], bool)

    def with_parameters(self, deviations: Mapping[str, float] | ArrayLike) -> Self:
        """This chain with `deviations` from the table in place of its own: by name (others 0), or all of them (P,).

        mm or rad. Raises ValueError for an unknown name or a wrong count.
        """
        if isinstance(deviations, Mapping):
            unknown = sorted(set(deviations) - set(self.parameters))
            if unknown:
                raise ValueError(f"not a parameter of this chain: {', '.join(unknown)}")
            values = np.array([float(deviations.get(name, 0.0)) for name in self.parameters])
        else:
            values = np.array(deviations, float)
        if values.shape != (len(self.parameters),):
            raise ValueError(f"{values.size} deviations for {len(self.parameters)} parameters")
        return replace(self, deviations=values)

    def with_base(self, base: ArrayLike) -> Self:
        """This chain with its base at `base` (4, 4) in the measuring frame; the base's deviations are set to zero."""
        return replace(self, base=_checked_pose("base", base), deviations=self._without("base_"))

    def with_tool(self, tool: ArrayLike) -> Self:
        """This chain with `tool` (4, 4) on its flange; the tool's deviations are set to zero."""
        return replace(self, tool=_checked_pose("tool", tool), deviations=self._without("tool_"))

    @cached_property
    def base_now(self) -> Floats:
        """Base in the measuring frame (4, 4) with its deviations."""
        return segment_matrix(self._motions[0])

    @cached_property
    def tool_now(self) -> Floats:
        """TCP in the flange frame (4, 4) with its deviations."""
        return segment_matrix(self._motions[-1])

    def forward(self, q: ArrayLike) -> Floats:
        """Pose of the TCP (..., 4, 4), mm, in the measuring frame, at model coordinates q (..., n)."""
        return self._batched(q, lambda angles: self._end(angles, self._constants[-1]), (4, 4))

    def forward_flange(self, q: ArrayLike) -> Floats:
        """Pose of the flange (..., 4, 4), mm, in the measuring frame, at model coordinates q (..., n)."""
        return self._batched(q, lambda angles: self._end(angles, self._last_link), (4, 4))

    def frames(self, q: ArrayLike) -> Floats:
        """The frames behind joints 1 … n, then the flange: (..., n + 1, 4, 4), mm, in the measuring frame.

        At model coordinates q (..., n). The frame behind a joint has its z along the joint's axis, and moves with it.
        """
        batch, angles = self._angles(q)
        result = np.zeros((self.n + 1, 4, 4, angles.shape[1]))
        result[:, 3, 3] = 1.0
        for start in range(0, angles.shape[1], BLOCK):
            frames, _ = self._frames(angles[:, start : start + BLOCK])
            result[:-1, :3, :, start : start + BLOCK] = frames[1:]
            result[-1, :3, :, start : start + BLOCK] = np.matmul(self._last_link.T, frames[-1])
        return np.moveaxis(result, -1, 0).reshape(*batch, self.n + 1, 4, 4)

    def tool_jacobian(self, q: ArrayLike) -> Floats:
        """Jacobian of the TCP by the joints: (..., 6, n) at q (..., n).

        Rows: velocity of the TCP (mm/rad; mm/m by a prismatic joint), angular velocity (rad/rad), along the measuring
        frame's axes.
        """
        return self._batched(q, lambda angles: self._joint_columns(*self._frames(angles)), (6, self.n))

    def forward_and_jacobian(self, q: ArrayLike) -> tuple[Floats, Floats]:
        """`forward` and `tool_jacobian` together: (..., 4, 4) and (..., 6, n)."""
        batch, angles = self._angles(q)
        pose, columns = np.empty((4, 4, angles.shape[1])), np.empty((6, self.n, angles.shape[1]))
        for start in range(0, angles.shape[1], BLOCK):
            part = np.s_[..., start : start + BLOCK]
            frames, end = self._frames(angles[part])
            pose[part] = _pose_block(end)
            columns[part] = self._joint_columns(frames, end)
        return _outside(pose, batch), _outside(columns, batch)

    def parameter_jacobian(self, q: ArrayLike) -> Floats:
        """Jacobian of the TCP by the parameters: (..., 6, P) at q (..., n), rows as in `tool_jacobian`.

        Each column is the parameter's unit screw at the TCP: (u × (p − r), u) for a turn about
        the axis u through r, (u, 0) for a slide along u. Per mm or per rad.
        """
        return self._batched(
            q, lambda angles: self._parameter_columns(*self._frames(angles)), (6, len(self.parameters))
        )

    @cached_property
    def _nominal(self) -> list[Segment]:
        """Base, the n + 1 segments between joints, tool: each a fixed pose and the motions after it."""
        between = self.table.segments
        return [(self.base, [*frame_motions("base")]), *between, (self.tool, [*frame_motions("tool")])]

    @cached_property
    def _motions(self) -> list[Segment]:
        """`_nominal` with the deviations added."""
        added = dict(zip(self.parameters, self.deviations, strict=True)) if self.deviations.size else {}
        return [
            (fixed, [motion._replace(value=motion.value + added.get(motion.name or "", 0.0)) for motion in motions])
            for fixed, motions in self._nominal
        ]

    def _without(self, prefix: str) -> Floats:
        if not self.deviations.size:
            return self.deviations
        keep = np.array([not name.startswith(prefix) for name in self.parameters])
        return np.asarray(self.deviations * keep)

    @cached_property
    def _last_link(self) -> Floats:
        """From the frame behind the last joint to the flange (4, 4)."""
        return segment_matrix(self._motions[-2])

    @cached_property
    def _constants(self) -> list[Floats]:
        """C0 … Cn: base with the motions before joint 1, …, the motions behind joint n with the tool."""
        between = [segment_matrix(segment) for segment in self._motions[1:-1]]
        between[0] = self.base_now @ between[0]
        between[-1] = between[-1] @ self.tool_now
        return between

    @cached_property
    def _screws(self) -> list[Screws]:
        """The parameters' screws by segment, in the order of `parameters`: base with segment 0, tool with segment n."""
        first = _screws(self._motions[0], np.eye(4))
        between = [_screws(segment, np.eye(4)) for segment in self._motions[1:-1]]
        between[0] = [*first, *_screws(self._motions[1], self.base_now)]
        between[-1] = [*between[-1], *_screws(self._motions[-1], self._last_link)]
        return [_stacked(rows) for rows in between]

    def _angles(self, q: ArrayLike) -> tuple[tuple[int, ...], Floats]:
        angles = np.asarray(q, float)
        if angles.ndim == 0 or angles.shape[-1] != self.n:
            raise ValueError(f"joint angles of shape {angles.shape} for {self.n} joints")
        return angles.shape[:-1], np.ascontiguousarray(angles.reshape(-1, self.n).T)

    def _batched(self, q: ArrayLike, work: Callable[[Floats], Floats], shape: tuple[int, int]) -> Floats:
        batch, angles = self._angles(q)
        result = np.empty((*shape, angles.shape[1]))
        for start in range(0, angles.shape[1], BLOCK):
            part = np.s_[..., start : start + BLOCK]
            result[part] = work(angles[part])
        return _outside(result, batch)

    def _frames(self, angles: Floats) -> tuple[Floats, Floats]:
        """Frames behind each joint (n + 1, 3, 4, N), the measuring frame first, and the tool's (3, 4, N)."""
        frames = np.empty((self.n + 1, 3, 4, angles.shape[1]))
        frames[0] = _MEASURING_FRAME
        cosines, sines, slides = np.cos(angles), np.sin(angles), self.table.slides
        for index in range(self.n):
            before = np.matmul(self._constants[index].T, frames[index])
            x, y, behind = before[:, 0], before[:, 1], frames[index + 1]
            if index in slides:
                behind[:] = before
                behind[:, 3] += MM_PER_M * angles[index] * before[:, 2]
                continue
            behind[:, 0] = cosines[index] * x + sines[index] * y
            behind[:, 1] = cosines[index] * y - sines[index] * x
            behind[:, 2:] = before[:, 2:]
        return frames, np.matmul(self._constants[-1].T, frames[-1])

    def _end(self, angles: Floats, last: Floats) -> Floats:
        return _pose_block(np.matmul(last.T, self._frames(angles)[0][-1]))

    def _joint_columns(self, frames: Floats, end: Floats) -> Floats:
        axes = frames[1:, :, 2].swapaxes(0, 1)
        arms = end[:, None, 3] - frames[1:, :, 3].swapaxes(0, 1)
        columns = np.concatenate([_cross(axes, arms), axes])
        for joint in self.table.slides:
            columns[:3, joint] = MM_PER_M * axes[:, joint]
            columns[3:, joint] = 0.0
        return columns

    def _parameter_columns(self, frames: Floats, end: Floats) -> Floats:
        result = np.zeros((6, len(self.parameters), frames.shape[-1]))
        start = 0
        for frame, screws in zip(frames, self._screws, strict=True):
            turns, columns = screws.turns, result[:, start : start + screws.turns.size]
            start += screws.turns.size
            axes = np.matmul(screws.direction, frame)
            arms = end[:, None, 3] - np.matmul(screws.point[turns], frame)
            columns[:3, ~turns] = axes[:, ~turns]
            columns[3:, turns] = axes[:, turns]
            columns[:3, turns] = _cross(axes[:, turns], arms)
        return result


_MEASURING_FRAME = np.eye(3, 4)[..., None]
_NO_TURN, _LAST_ROW = np.eye(3), np.array([0.0, 0.0, 0.0, 1.0])
_ORTHONORMAL_WITHIN, _LAST_ROW_WITHIN = 1e-6 + 1e-5 * _NO_TURN, 1e-8 + 1e-5 * _LAST_ROW
"""As `np.allclose` counts, which takes ten times as long: a search of set-up errors places a base 100 000 times."""


def _checked_pose(name: str, matrix: ArrayLike | None) -> Floats:
    result = np.eye(4) if matrix is None else np.array(matrix, float)
    if result.shape != (4, 4) or not (np.abs(result[3] - _LAST_ROW) <= _LAST_ROW_WITHIN).all():
        raise ValueError(f"{name} is not a 4×4 pose")
    turn = result[:3, :3]
    if not (np.abs(turn @ turn.T - _NO_TURN) <= _ORTHONORMAL_WITHIN).all() or np.linalg.det(turn) < 0:
        raise ValueError(f"{name} is not a rigid motion: its rotation part is not orthonormal and right-handed")
    return result


def _screws(segment: Segment, start: Floats) -> list[tuple[bool, Floats, Floats]]:
    """Turn or slide, direction and point of each named motion of a segment that begins at pose `start` (4, 4)."""
    place, motions = start @ segment[0], segment[1]
    rows = []
    for motion in motions:
        if motion.name:
            rows.append((motion.turns, np.append(place[:3, motion.axis], 0.0), place[:, 3]))
        place = place @ motion_matrix(motion)
    return rows


def _stacked(rows: Sequence[tuple[bool, Floats, Floats]]) -> Screws:
    turns = np.array([row[0] for row in rows], bool)
    vectors = np.array([[row[1], row[2]] for row in rows], float).reshape(-1, 2, 4)
    return Screws(turns, vectors[:, 0], vectors[:, 1])


def _cross(left: Floats, right: Floats) -> Floats:
    """Cross product along the first axis."""
    return np.stack(
        [
            left[1] * right[2] - left[2] * right[1],
            left[2] * right[0] - left[0] * right[2],
            left[0] * right[1] - left[1] * right[0],
        ]
    )


def _pose_block(end: Floats) -> Floats:
    result = np.zeros((4, 4, end.shape[-1]))
    result[:3] = end
    result[3, 3] = 1.0
    return result


def _outside(block: Floats, batch: tuple[int, ...]) -> Floats:
    """(r, c, N) as (..., r, c): a view, no copy."""
    return np.moveaxis(block, -1, 0).reshape(*batch, *block.shape[:2])
