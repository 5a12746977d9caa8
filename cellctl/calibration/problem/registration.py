"""Start values from nominal and the rows: base and tool, fixed points, and the zeros of instruments for lengths.

**Base and tool.** A measured point is m = B (R t + p): flange rotation R and position p, tool t, base B = (R_B, b).
With G = R_Bᵀ and g = −R_Bᵀ b,

    G m + g − R t = p

is linear in the 15 numbers of G, g, t if G may be any matrix: no start value and no local optimum. Only t is taken
from it; the rigid base follows by the closed form of Kabsch (1976), and `STEPS` Gauss–Newton steps on the rigid
problem, with turns and slides of the base and the tool as unknowns. The same steps start from the taught tool; the
other end counts only if it leaves less than `PREFERRED` of the squares.

They move the tool along no direction that they find worse than it was taught. The tool's information with the base
eliminated is the Schur complement L_tᵀ (I − Q Qᵀ) L_t, Q a basis of the base's columns; a direction of eigenvalue λ
has σ = s/√λ, s the scatter of the residuals from their median. With (nearly) one orientation in all rows a longer tool
acts as a base further in, λ ≈ 0, and the noise of the joints would decide the tool, decimetres away.

**Zeros of lengths.** A draw-wire counts from where it was switched on; a ball-bar without its calibration piece
measures changes of length: each shows ℓ = |p − a| + z. Squared, |p − a|² = (ℓ − z)² is linear in the point a, the zero
z and, once for each point, |a|² − z².
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, final

import numpy as np

from cellctl.calibration.model.parameter import Group
from cellctl.calibration.model.robot_model import RobotModel
from cellctl.calibration.model.unknowns import PLACED, State
from cellctl.calibration.rows import Measured
from cellctl.kinematics import Floats, SerialChain, pose

STEPS = 4
"""The problem is linear but for the base's turn, whose start is off by milliradians: the errors left fall from step to
step as their squares, 1e-3, 1e-6, 1e-12."""

RCOND = 1e-6
"""Of the normal equations: directions of base and tool that move the points less than a thousandth (√1e-6) as far as
the strongest are not changed."""

NORMAL_MEDIAN = 0.6745
"""Median of |x| of a standard normal x: the median absolute deviation divided by it estimates σ (Huber 1981, Robust
Statistics)."""

HELD_AT_MOST = 1.1
"""A held tool leaves at most this many times the squares of a free one, else it stays free: the scatter, and so the σ
by which its directions are held, says nothing where many rows are wrong or the taught tool is far off."""

PREFERRED = 0.25
"""The tool of the linear problem is used if its squared residual is below this share of the taught tool's: where
orientation hardly changes it is poorly determined.
"""


def on_instrument(
    model: RobotModel, blocks: Sequence[Measured], free: frozenset[Group], taught_mm: float = np.inf
) -> RobotModel:
    """`model` with those of base and tool that are `free` fitted to the positions and poses among `blocks`.

    taught_mm: 1 σ of the model's own tool; inf where it is unknown.
    """
    measured = [(block, xyz) for block in blocks if len(block) and (xyz := block.positions) is not None]
    if not measured or not free & PLACED:
        return model
    q, xyz = np.concatenate([block.q for block, _ in measured]), np.concatenate([places for _, places in measured])
    chain = _placed(model.chain, q, xyz, free, taught_mm)
    turned = [(block.q, turns) for block, _ in measured if (turns := block.orientations) is not None]
    if "tool" in free and turned:
        at, turns = (np.concatenate(part) for part in zip(*turned, strict=True))
        chain = turned_tool(chain, at, turns)
    return replace(model, chain=chain)


def fixed_points(models: Sequence[RobotModel], blocks: Sequence[Measured], rough: Floats) -> Floats:
    """Spheres, anchors, sockets and poles of planes (S, 3), mm: `rough` where that is known (else NaN), otherwise from
    the first block that measured each; points without a measurement are put in the middle of the others.
    """
    points = rough.copy()
    for index in np.flatnonzero(np.isnan(points).any(axis=1)):
        points[index] = _point(models, blocks, int(index))
    if np.isnan(points).any():
        seen = np.concatenate([models[block.session].tcp(block.postures) for block in blocks])
        points = np.where(np.isnan(points), seen.mean(axis=0), points)
    return points


def rigid_fit(points: Floats, measured: Floats) -> Floats:
    """The pose (4, 4) that carries `points` (N, 3) nearest to `measured` (N, 3) (Kabsch); right-handed always.

    All points have the same weight, whatever their σ: these are start values.
    """
    centre, there = points.mean(axis=0), measured.mean(axis=0)
    u, _, vt = np.linalg.svd((measured - there).T @ (points - centre))
    turn = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt)) or 1.0]) @ vt
    return pose(turn, there - turn @ centre)


def base_and_tool(flange: Floats, measured: Floats, taught: Floats, taught_mm: float = np.inf) -> tuple[Floats, Floats]:
    """Base (4, 4) and tool (4, 4) that carry flange poses (N, 4, 4) nearest to `measured` (N, 3), mm; the tool keeps
    the orientation of `taught` (4, 4), and its place along directions that the rows know worse than `taught_mm` (1 σ).
    """
    everywhere = np.eye(3)
    base, tool = _refined(flange, measured, taught[:3, 3], everywhere)
    other = _refined(flange, measured, _relaxed_tool(flange, measured), everywhere)
    if _sum_of_squares(flange, measured, *other) < PREFERRED * _sum_of_squares(flange, measured, base, tool):
        base, tool = other
    known = _known_directions(flange, measured, base, tool, taught_mm)
    if known.shape[1] < 3:
        held = _refined(flange, measured, taught[:3, 3], known)
        if _sum_of_squares(flange, measured, *held) <= HELD_AT_MOST * _sum_of_squares(flange, measured, base, tool):
            base, tool = held
    return base, pose(taught[:3, :3], tool)


def turned_tool(chain: SerialChain, q: Floats, measured: Floats) -> SerialChain:
    """`chain` with its tool turned to fit `measured` rotations (N, 3, 3) at q (N, n), rad."""
    from scipy.spatial.transform import Rotation  # at first use: it takes 0.2 s

    flange = chain.forward_flange(q)[:, :3, :3]
    turn = Rotation.from_matrix(np.matmul(np.swapaxes(flange, -1, -2), measured)).mean().as_matrix()
    return chain.with_tool(pose(turn, chain.tool_now[:3, 3]))


def _placed(chain: SerialChain, q: Floats, measured: Floats, free: frozenset[Group], taught_mm: float) -> SerialChain:
    """`chain` with base, tool, or both fitted to `measured` (N, 3), mm, at q (N, n), rad."""
    flange = chain.with_base(np.eye(4)).forward_flange(q)
    base, tool = chain.base_now, chain.tool_now
    if free >= PLACED:
        base, tool = base_and_tool(flange, measured, tool, taught_mm)
        return chain.with_base(base).with_tool(tool)
    if "base" in free:
        return chain.with_base(rigid_fit(_tips(flange, np.eye(4), tool[:3, 3]), measured))
    # the base is known: each row measures the tool in the flange frame, Rᵀ(B⁻¹m − p), and their mean is least squares
    wanted = (measured - base[:3, 3]) @ base[:3, :3] - flange[:, :3, 3]
    offset = np.einsum("nji,nj->ni", flange[:, :3, :3], wanted).mean(axis=0)
    return chain.with_tool(pose(tool[:3, :3], offset))


def _relaxed_tool(flange: Floats, measured: Floats) -> Floats:
    """The tool (3,) of the linear problem in which the base may be any affine map."""
    middle = measured - measured.mean(axis=0)
    size = max(float(np.abs(middle).max()), 1e-9)  # the columns of G in the size of those of t
    lines = np.zeros((len(flange), 3, 15))
    for axis in range(3):
        lines[:, axis, 3 * axis : 3 * axis + 3] = middle / size
        lines[:, axis, 9 + axis] = 1.0
    lines[:, :, 12:] = -flange[:, :3, :3]
    flat = lines.reshape(-1, 15)
    return np.asarray(np.linalg.lstsq(flat.T @ flat, flat.T @ flange[:, :3, 3].ravel(), rcond=1e-10)[0][12:])


def _refined(flange: Floats, measured: Floats, tool: Floats, along: Floats) -> tuple[Floats, Floats]:
    """Gauss–Newton from the rigid base that goes with `tool` (3,), which moves along directions `along` (3, K) only."""
    from scipy.spatial.transform import Rotation  # at first use: it takes 0.2 s

    base = rigid_fit(_tips(flange, np.eye(4), tool), measured)
    for _ in range(STEPS):
        lines, residual, size = _linear(flange, measured, base, tool)
        lines = np.hstack([lines[:, :6], lines[:, 6:] @ along])
        step = np.linalg.lstsq(lines.T @ lines, lines.T @ residual, rcond=RCOND)[0]
        turn = Rotation.from_rotvec(step[:3] / size).as_matrix()
        base = pose(turn @ base[:3, :3], base[:3, 3] + step[3:6])
        tool = tool + along @ step[6:]
    return base, tool


def _linear(flange: Floats, measured: Floats, base: Floats, tool: Floats) -> tuple[Floats, Floats, float]:
    """Derivative (3 N, 9) of the points by turns of the base (times `size`, mm), its slides and the tool; what is left
    (3 N,), mm; and `size`.
    """
    there = _tips(flange, base, tool)
    arms = there - base[:3, 3]
    size = max(float(np.abs(arms).max()), 1e-9)
    lines = np.zeros((len(flange), 3, 9))
    x, y, z = (arms / size).T
    # ∂(ω × r)/∂ω = −[r]×: its columns are the unit vectors' cross products with the arm r
    lines[:, 1, 0], lines[:, 2, 0] = -z, y
    lines[:, 0, 1], lines[:, 2, 1] = z, -x
    lines[:, 0, 2], lines[:, 1, 2] = -y, x
    lines[:, [0, 1, 2], [3, 4, 5]] = 1.0
    lines[:, :, 6:] = base[:3, :3] @ flange[:, :3, :3]
    return lines.reshape(-1, 9), (measured - there).ravel(), size


def _known_directions(flange: Floats, measured: Floats, base: Floats, tool: Floats, taught_mm: float) -> Floats:
    """Directions (3, K) of the tool that the points know to `taught_mm` (1 σ) or better, whatever the base is.

    σ = s / √λ of the tool's information with the base eliminated (Schur complement), s: the scatter about the best fit,
    from the median, which outliers hardly change. It is not divided by the redundancy: with 10 points (30 numbers, 9
    unknowns) s is some 16 % too small.
    """
    if np.isinf(taught_mm):
        return np.eye(3)
    lines, residual, _ = _linear(flange, measured, base, tool)
    of_base = np.linalg.qr(lines[:, :6])[0]
    own = lines[:, 6:] - of_base @ (of_base.T @ lines[:, 6:])
    scatter = float(np.median(np.abs(residual))) / NORMAL_MEDIAN
    information, directions = np.linalg.eigh(own.T @ own)
    return np.asarray(directions[:, scatter**2 <= taught_mm**2 * information])


def _tips(flange: Floats, base: Floats, tool: Floats) -> Floats:
    return np.asarray((flange[:, :3, :3] @ tool + flange[:, :3, 3]) @ base[:3, :3].T + base[:3, 3])


def _sum_of_squares(flange: Floats, measured: Floats, base: Floats, tool: Floats) -> float:
    return float(np.sum((_tips(flange, base, tool) - measured) ** 2))


def _point(models: Sequence[RobotModel], blocks: Sequence[Measured], index: int) -> Floats:
    """Place (3,) of point `index` by the first block that measured it; NaN where none did."""
    for block in blocks:
        if np.any(mine := block.telling(index)):
            return block.pick(mine).place(models[block.session])
    return np.full(3, np.nan)


CONSTANT_SCALE_MM2 = 1000.0
"""Unit of the constants |a|² − z² of the linear problem, so that their columns have the size of the others: metres."""


def with_datums(state: State, blocks: Sequence[Measured]) -> State:
    """`state` with start values from `blocks`: its datums, and the points that only instruments without a zero
    measured to. All other points stay as in `state`.
    """
    points, datums = state.points.copy(), state.datums.copy()
    known = np.array([any(block.telling(point).any() for block in blocks) for point in range(len(points))])
    for index in range(len(datums)):
        rows = _Lengths.of(state, blocks, index)
        if not len(rows.shown):
            continue
        at_known = known[rows.point]
        if at_known.any():
            datums[index] = np.median(rows.beyond(points)[at_known])
        else:
            datums[index] = rows.datum(points)
        for point in np.unique(rows.point[~at_known]):
            points[point] = rows.place(point, points[point], datums[index])
            known[point] = True
    return replace(state, points=points, datums=datums)


@final
@dataclass(frozen=True, eq=False)
class _Lengths:
    """What one instrument showed (N,), mm, with the tool at TCPs (N, 3), to the points of index point (N,)."""

    tcps: Floats
    shown: Floats
    point: Any

    @classmethod
    def of(cls, state: State, blocks: Sequence[Measured], datum: int) -> _Lengths:
        """Those of the instrument of number `datum`."""
        tcps, shown, point = [np.zeros((0, 3))], [np.zeros(0)], [np.zeros(0, int)]
        for block in blocks:
            if block.distances is not None and np.any(mine := block.zeros == datum):
                tcps.append(state.models[block.session].tcp(block.postures.pick(mine)))
                shown.append(block.distances[mine])
                point.append(block.visited[mine])
        return cls(np.concatenate(tcps), np.concatenate(shown), np.concatenate(point))

    def beyond(self, points: Floats) -> Floats:
        """Its readings minus the distances from `points` (S, 3): (N,), mm."""
        return np.asarray(self.shown - np.linalg.norm(self.tcps - points[self.point], axis=-1))

    def datum(self, points: Floats) -> float:
        """Its reading at length 0, with free points; where the rows leave it open, near `points` (S, 3) and 0."""
        lines, right = self._linear(points)
        # no length is negative, so that no zero is above the smallest reading
        return float(min(_solved(np.column_stack([lines, -2.0 * self.shown]), right)[-1], self.shown.min()))

    def place(self, point: int, near: Floats, datum: float) -> Floats:
        """Place (3,) that fits the rows of `point` best with `datum` known; where they leave it open, `near`."""
        mine = self.point == point
        alone = _Lengths(self.tcps[mine], self.shown[mine] - datum, np.zeros(np.count_nonzero(mine), int))
        return np.asarray(near + _solved(*alone._linear(near[None]))[:3])

    def _linear(self, points: Floats) -> tuple[Floats, Floats]:
        """Lines (N, 4 U) and right side (N,), mm²: the steps of its U points from `points` (S, 3), mm, and
        the constants, `CONSTANT_SCALE_MM2` mm² each.
        """
        there, number = np.unique(self.point, return_inverse=True)
        away, each = self.tcps - points[self.point], np.arange(len(self.shown))
        lines = np.zeros((len(self.shown), len(there), 4))
        lines[each, number, :3], lines[each, number, 3] = 2.0 * away, CONSTANT_SCALE_MM2
        return lines.reshape(len(self.shown), -1), np.sum(away**2, axis=1) - self.shown**2


def _solved(lines: Floats, right: Floats) -> Floats:
    return np.asarray(np.linalg.lstsq(lines, right, rcond=1e-6)[0])
