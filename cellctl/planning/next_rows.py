"""Which rows to measure next: candidates like the measured rows, and those that reduce the uncertainty most.

The gain of a row does not depend on its reading: with Jacobian a, in its standard deviations, the posterior covariance
C becomes C − Caᵀ(1 + aCaᵀ)⁻¹aC. The value of a row is the reduction of the mean variance of the requested TCPs
(A-optimal, not D-optimal: parameters without effect on them have no value). Rows are chosen one by one, each with those
before it taken as measured. The products of all candidates A with C are not computed anew for each: AC becomes
AC − (ACaᵀ)(1 + aCaᵀ)⁻¹aC.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Self, final

import numpy as np
from numpy.typing import NDArray

from cellctl.calibration import (
    Measured,
    PlaneRows,
    PoseRows,
    PositionRows,
    Postures,
    RobotModel,
    SocketRows,
    State,
    TouchRows,
)
from cellctl.kinematics import Bools, Floats
from cellctl.kinematics.low_discrepancy import sobol

WIDER_RAD, WIDER_SHARE = np.deg2rad(30.0), 0.25
"""Joints may exceed the range of the rows by this much, or by this share of the range, whichever is more."""

ROOM_SHARE = 0.1
"""TCPs may lie outside the measured volume by this share of its diagonal."""

_TRIED = 16
"""Postures tried for each one wanted."""

_STEPS, _CLOSE_MM = 20, 1e-3


@final
@dataclass(frozen=True, eq=False)
class Advice:
    """The most valuable rows, best first.

    chosen (K,): indices of candidates. sigma_mm (K + 1,): 1 σ, 3-D, RMS over the requested points, now and after each
    row. narrowed (K, P): each parameter's σ after the row as a share of that before, 1 where the row does not affect
    it. at_random_mm: 1 σ after as many random candidates.
    """

    chosen: tuple[int, ...]
    sigma_mm: Floats
    narrowed: Floats
    at_random_mm: float

    def beside(self, more_mm: float) -> Self:
        """With `more_mm`, 1 σ, 3-D, RMS, in each σ: what these rows do not lower."""
        return replace(
            self, sigma_mm=np.hypot(self.sigma_mm, more_mm), at_random_mm=float(np.hypot(self.at_random_mm, more_mm))
        )


def next_rows(covariance: Floats, asked: Floats, candidates: Floats, count: int) -> Advice:
    """The `count` of `candidates` that reduce the mean variance of the requested points most.

    covariance (P, P): posterior, in the parameters' units. asked (3 N, P): derivative of the requested points by the
    parameters, mm (`shape_columns`). candidates (M, k, P): Jacobians of rows in their standard deviations, filled up
    with zeros where a row has fewer than k numbers.
    """
    count = min(count, len(candidates))
    weight, points = asked.T @ asked, len(asked) / 3.0
    chosen: list[int] = []
    known, sigma, narrowed = covariance, [_sigma(covariance, weight, points)], []
    # tensordot: one product; `@` multiplies a stack one by one, three times slower
    carried = np.tensordot(candidates, covariance, 1)
    weighted = np.tensordot(carried, weight, 1)
    for _ in range(count):
        worth = _gains(candidates, carried, weighted)
        worth[chosen] = -np.inf
        best = int(np.argmax(worth))
        row, after = candidates[best], _updated(known, candidates[best])
        shared, answer = carried @ row.T, _answer(known, row)
        carried = carried - np.tensordot(shared, answer, 1)
        weighted = weighted - np.tensordot(shared, answer @ weight, 1)
        narrowed.append(_narrowed(known, after))
        known, chosen = after, [*chosen, best]
        sigma.append(_sigma(known, weight, points))
    spread = np.linspace(0, max(len(candidates) - 1, 0), count).astype(int)
    without_choice = _updated(covariance, candidates[spread].reshape(-1, len(covariance)))
    return Advice(
        chosen=tuple(chosen),
        sigma_mm=np.array(sigma),
        narrowed=np.array(narrowed).reshape(count, len(covariance)),
        at_random_mm=_sigma(without_choice, weight, points),
    )


def _gains(candidates: Floats, carried: Floats, weighted: Floats) -> Floats:
    """Reduction (M,) of trace(WC) by each of `candidates` A alone; carried: AC, weighted: ACW, all (M, k, P)."""
    spread = np.eye(candidates.shape[1]) + carried @ np.swapaxes(candidates, 1, 2)
    felt = weighted @ np.swapaxes(carried, 1, 2)
    return np.asarray(np.trace(np.linalg.solve(spread, felt), axis1=1, axis2=2))


def _updated(covariance: Floats, row: Floats) -> Floats:
    """The covariance (P, P) after a measurement with Jacobian `row` (k, P), in its standard deviations."""
    after = covariance - (row @ covariance).T @ _answer(covariance, row)
    return np.asarray((after + after.T) / 2.0)


def _answer(covariance: Floats, row: Floats) -> Floats:
    """(1 + aCaᵀ)⁻¹aC (k, P) of `row` a (k, P)."""
    carried = row @ covariance
    return np.asarray(np.linalg.solve(np.eye(len(row)) + carried @ row.T, carried))


def _sigma(covariance: Floats, weight: Floats, points: float) -> float:
    return float(np.sqrt(max(float(np.sum(weight * covariance)), 0.0) / points))


def _narrowed(before: Floats, after: Floats) -> NDArray[np.float64]:
    old, new = np.diag(before), np.diag(after)
    unsure = old > 0.0
    return np.asarray(np.sqrt(np.where(unsure, np.maximum(new, 0.0), 1.0) / np.where(unsure, old, 1.0)))


@final
@dataclass(frozen=True, eq=False)
class Room:
    """Limits of postures: model angles lower … upper (n,), rad; TCPs in a box low … high (3,), mm."""

    lower: Floats
    upper: Floats
    low: Floats
    high: Floats

    @classmethod
    def about(cls, q: Floats, tips: Floats, limits: Floats) -> Self:
        """About rows at model angles q (N, n), rad, with TCPs at `tips` (N, 3), mm; limits (n, 2): of the joints."""
        first, last = q.min(axis=0), q.max(axis=0)
        wider = np.maximum(WIDER_RAD, WIDER_SHARE * (last - first))
        low, high = tips.min(axis=0), tips.max(axis=0)
        room = ROOM_SHARE * float(np.linalg.norm(high - low))
        return cls(
            np.minimum(first, np.maximum(first - wider, limits[:, 0])),
            np.maximum(last, np.minimum(last + wider, limits[:, 1])),
            low - room,
            high + room,
        )

    def holds(self, q: Floats) -> Bools:
        """Which postures (N, n) are within the joint limits of the room."""
        return np.asarray(((q >= self.lower) & (q <= self.upper)).all(axis=1))

    def contains(self, tips: Floats) -> Bools:
        """Which points (N, 3) are in the box."""
        return np.asarray(((tips >= self.low) & (tips <= self.high)).all(axis=1))

    def spread(self, count: int) -> Floats:
        """Postures (count, n), quasi-random."""
        samples = _evenly(len(self.lower), count)
        return np.asarray(self.lower + samples * (self.upper - self.lower))


def rows_like(block: Measured, state: State, limits: Floats, count: int = 512) -> Measured:
    """Up to `count` rows that could be measured like those of `block`, in its session, none of them measured yet.

    state: robot and points as identified. limits (n, 2): model angles that the joints can reach, rad. Positions and
    poses: anywhere in and near the measured volume. Touches and sockets: at the same points, within the directions of
    approach and the tilts of the tool used before. Collisions are not checked. The result may be empty.
    """
    model, postures = state.models[block.session], block.postures
    tips = model.tcp(postures)
    room = Room.about(block.q, tips, limits)
    q = room.spread(_TRIED * count)
    if isinstance(block, PositionRows | PoseRows):
        return _measuring(block, model, _as_before(postures, _within(model, room, q, count)))
    if isinstance(block, PlaneRows):
        return _on_planes(block, state, room, q[: 4 * count], count)
    if isinstance(block, TouchRows | SocketRows):
        return _visiting(block, state, room, q[: 4 * count], count)
    return block.pick(np.zeros(0, int))  # for other kinds no candidates are defined


def _within(model: RobotModel, room: Room, q: Floats, count: int) -> Floats:
    """Up to `count` postures with the TCP in the room: of q (M, n), and where hardly any is inside, moved there."""
    found = q[room.contains(model.tcp(q))][:count]
    if len(found) >= count // 4:
        return found
    led, arrived = led_to(model, q[:count], room.low + _evenly(3, min(count, len(q))) * (room.high - room.low))
    return np.concatenate([found, led[arrived & room.holds(led)]])[:count]


def _measuring(block: PositionRows | PoseRows, model: RobotModel, at: Postures) -> Measured:
    sigma = np.tile(np.median(block.sigma, axis=0), (len(at), 1))
    if isinstance(block, PositionRows):
        return replace(block, at=at, xyz=model.tcp(at), sigma=sigma, decorrelation=None, datum=None)
    return replace(block, at=at, poses=model.pose(at), sigma=sigma, decorrelation=None, datum=None)


def _visiting(block: TouchRows | SocketRows, state: State, room: Room, q: Floats, count: int) -> Measured:
    """Rows at the block's points, reached from postures q (M, n) by the shortest joint motion."""
    model, touched = state.models[block.session], isinstance(block, TouchRows)
    names, turn = np.unique(block.point), np.arange(len(q))
    point = names[turn % len(names)]
    away = _away(block, state, point) if isinstance(block, TouchRows) else np.zeros((len(q), 3))
    reached, arrived = led_to(model, q, state.points[point] + away)
    good = arrived & room.holds(reached)
    if touched:
        good &= _leaning(model, reached, away) >= _least_leaning(block, state)
    chosen = np.flatnonzero(good)[:count]
    sigma = np.tile(np.median(block.sigma, axis=0), (len(chosen), 1))
    at = _as_before(block.postures, reached[chosen])
    if isinstance(block, SocketRows):
        return replace(block, at=at, point=point[chosen], sigma=sigma)
    datum = _datums(block)[point[chosen]]
    reach = np.linalg.norm(away[chosen], axis=1) + np.append(state.datums, 0.0)[datum]
    return replace(block, at=at, point=point[chosen], sigma=sigma, reach=reach, datum=datum)


def _on_planes(block: PlaneRows, state: State, room: Room, q: Floats, count: int) -> Measured:
    """Rows on the block's planes between existing touches, reached from postures q (M, n)."""
    model, normals = state.models[block.session], block.normals(state)
    tips = model.tcp(block.postures) - block.residual(state) * normals
    names, share = np.unique(block.point), _evenly(3, len(q))
    of_plane = [np.flatnonzero(block.point == names[turn % len(names)]) for turn in range(len(q))]
    first, second = (
        np.array([rows[int(part * len(rows))] for rows, part in zip(of_plane, share[:, column], strict=True)])
        for column in (0, 1)
    )
    goal = tips[first] + share[:, 2:] * (tips[second] - tips[first])
    reached, arrived = led_to(model, q, goal)
    least = float(_leaning(model, block.q, normals).min())
    chosen = np.flatnonzero(arrived & room.holds(reached) & (_leaning(model, reached, normals[first]) >= least))[:count]
    sigma = np.tile(np.median(block.sigma, axis=0), (len(chosen), 1))
    there = block.pick(first[chosen])
    there = replace(there, at=_as_before(block.postures, reached[chosen]), sigma=sigma)
    return replace(there, reach=there.reach + there.residual(state)[:, 0])


def _away(block: TouchRows, state: State, point: Floats) -> Floats:
    """Vectors (M, 3), mm, from the centre of each of `point` (M,) to a possible touch."""
    lengths = block.lengths(state)
    reach = {name: float(np.median(lengths[block.point == name])) for name in np.unique(block.point)}
    return np.array([reach[name] for name in point])[:, None] * _normals(block, state, point)


def _datums(block: TouchRows) -> Any:
    """The datum of the last measurement to each point, up to the last point of the block."""
    result = np.full(int(block.point.max()) + 1, -1)
    result[block.point] = block.datum
    return result


def led_to(model: RobotModel, q: Floats, targets: Floats) -> tuple[Floats, Bools]:
    """Model angles (M, n) near q (M, n) with the TCP at `targets` (M, 3), mm; and which reached it."""
    chain = model.chain
    for _ in range(_STEPS):
        columns = chain.tool_jacobian(q)[:, :3]
        off = targets - chain.forward(q)[:, :3, 3]
        square = columns @ np.swapaxes(columns, 1, 2)
        damped = square + 1e-6 * np.trace(square, axis1=1, axis2=2)[:, None, None] * np.eye(3)
        step = np.einsum("mrn,mr->mn", columns, np.linalg.solve(damped, off[..., None])[..., 0])
        q = q + step / np.maximum(np.abs(step).max(axis=1, keepdims=True) / 0.5, 1.0)
    return q, np.linalg.norm(targets - chain.forward(q)[:, :3, 3], axis=1) < _CLOSE_MM


def _normals(block: TouchRows, state: State, point: Floats) -> Floats:
    """A direction (M, 3) from each of `point` (M,), within the widest cone about their mean that was touched there."""
    tips = state.models[block.session].tcp(block.postures)
    measured = _unit(tips - state.points[block.point])
    samples = _evenly(2, len(point))
    result = np.zeros((len(point), 3))
    for name in np.unique(point):
        mine, seen = point == name, measured[block.point == name]
        middle = _unit(seen.mean(axis=0, keepdims=True))[0]
        cosine = 1.0 - samples[mine, 0] * (1.0 - float((seen @ middle).min()))
        result[mine] = _about(middle, cosine, 2.0 * np.pi * samples[mine, 1])
    return result


def _about(middle: Floats, cosine: Floats, turn: Floats) -> Floats:
    """Unit vectors (M, 3) at the angle arccos `cosine` (M,) from `middle` (3,), turned about it by `turn` (M,), rad."""
    x = _unit(np.cross(np.eye(3)[np.abs(middle).argmin()], middle)[None])[0]
    y, sine = np.cross(middle, x), np.sqrt(np.maximum(1.0 - cosine**2, 0.0))
    across = np.cos(turn)[:, None] * x + np.sin(turn)[:, None] * y
    return np.asarray(cosine[:, None] * middle + sine[:, None] * across)


def _leaning(model: RobotModel, q: Floats, away: Floats) -> Floats:
    """Cosine (M,) between the tool, from TCP to flange, and the direction `away` (M, 3) from the surface."""
    shaft = model.chain.forward_flange(q)[:, :3, 3] - model.chain.forward(q)[:, :3, 3]
    return np.asarray(np.sum(_unit(shaft) * _unit(away), axis=1))


def _least_leaning(block: TouchRows | SocketRows, state: State) -> float:
    model = state.models[block.session]
    return float(_leaning(model, block.q, model.tcp(block.postures) - state.points[block.point]).min())


def _as_before(before: Postures, q: Floats) -> Postures:
    """Postures at q (M, n) under conditions like those before: joints are approached from both sides if any row was."""
    some, rng = np.arange(len(q)) % len(before), np.random.default_rng(3)
    approach = None if before.approach is None else rng.choice([-1.0, 1.0], q.shape)
    delta_t = None if before.delta_t is None else np.full(len(q), np.median(before.delta_t))
    loads = (None if part is None else part[some] for part in (before.payload, before.payload_at, before.currents))
    return Postures(q, approach, delta_t, *loads)


def _evenly(dimensions: int, count: int) -> Floats:
    """Points (count, dimensions) of the unit cube, quasi-random (Sobol; drawn in powers of two)."""
    drawn = sobol(dimensions, rng=np.random.default_rng(1)).random(1 << max(count - 1, 0).bit_length())
    return np.asarray(drawn[:count])


def _unit(vectors: Floats) -> Floats:
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12))
