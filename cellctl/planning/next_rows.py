"""Which rows to measure next: candidates like the measured rows, and those that reduce the uncertainty most.

The value of a row is the reduction of the mean variance of the requested TCPs (`design`): parameters without effect on
them have no value. Rows are chosen one by one, each with those before it taken as measured.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Self, final

import numpy as np
from numpy.typing import NDArray

from cellctl.calibration import Measured, Postures, RobotModel, State
from cellctl.kinematics import Bools, Floats
from cellctl.kinematics.low_discrepancy import evenly
from cellctl.planning.design import Design, sigma_of, updated

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
    design, weight, points = Design(covariance, candidates, asked), asked.T @ asked, len(asked) / 3.0
    chosen: list[int] = []
    sigma, narrowed = [sigma_of(covariance, weight, points)], []
    for _ in range(count):
        worth, before = design.gains(), design.covariance
        worth[chosen] = -np.inf
        chosen.append(int(np.argmax(worth)))
        design.measure(chosen[-1])
        narrowed.append(_narrowed(before, design.covariance))
        sigma.append(sigma_of(design.covariance, weight, points))
    spread = np.linspace(0, max(len(candidates) - 1, 0), count).astype(int)
    without_choice = updated(covariance, candidates[spread].reshape(-1, len(covariance)))
    return Advice(
        chosen=tuple(chosen),
        sigma_mm=np.array(sigma),
        narrowed=np.array(narrowed).reshape(count, len(covariance)),
        at_random_mm=sigma_of(without_choice, weight, points),
    )


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
        samples = evenly(len(self.lower), count)
        return np.asarray(self.lower + samples * (self.upper - self.lower))


@final
@dataclass(frozen=True, eq=False)
class _Reachable:
    """Postures for rows like those of `block`, near q (M, n), up to `count`; collisions are not checked."""

    block: Measured
    state: State
    room: Room
    q: Floats
    count: int

    @property
    def tried(self) -> int:
        """Number of goals."""
        return 4 * self.count

    @property
    def model(self) -> RobotModel:
        """Of the block's session."""
        return self.state.models[self.block.session]

    def anywhere(self) -> Postures:
        """Postures in the room."""
        return _as_before(self.block.postures, _within(self.model, self.room, self.q, self.count))

    def at(self, goals: Floats, normals: Floats | None = None) -> tuple[Postures, Any]:
        """Postures (K) with the TCP at some of `goals` (tried, 3), mm, and which (K,); by the shortest joint motion."""
        reached, arrived = led_to(self.model, self.q[: self.tried], goals)
        good = arrived & self.room.holds(reached)
        if normals is not None:
            least = _leaning(self.model, self.block.q, self.block.normals(self.state)).min()
            good &= _leaning(self.model, reached, normals) >= least
        chosen = np.flatnonzero(good)[: self.count]
        return _as_before(self.block.postures, reached[chosen]), chosen


def rows_like(block: Measured, state: State, limits: Floats, count: int = 512) -> Measured | None:
    """Up to `count` rows that could be measured like those of `block`, in its session, none of them measured yet.

    state: robot and points as identified. limits (n, 2): model angles that the joints can reach, rad. Where, the kind
    of the rows states (`Measured.proposed`). The result may be empty; None: the kind does not state where.
    """
    room = Room.about(block.q, state.models[block.session].tcp(block.postures), limits)
    return block.proposed(state, _Reachable(block, state, room, room.spread(_TRIED * count), count))


def _within(model: RobotModel, room: Room, q: Floats, count: int) -> Floats:
    """Up to `count` postures with the TCP in the room: of q (M, n), and where hardly any is inside, moved there."""
    found = q[room.contains(model.tcp(q))][:count]
    if len(found) >= count // 4:
        return found
    led, arrived = led_to(model, q[:count], room.low + evenly(3, min(count, len(q))) * (room.high - room.low))
    return np.concatenate([found, led[arrived & room.holds(led)]])[:count]


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


def _leaning(model: RobotModel, q: Floats, away: Floats) -> Floats:
    """Cosine (M,) between the tool, from TCP to flange, and the direction `away` (M, 3) from the surface."""
    shaft = model.chain.forward_flange(q)[:, :3, 3] - model.chain.forward(q)[:, :3, 3]
    return np.asarray(np.sum(_unit(shaft) * _unit(away), axis=1))


def _as_before(before: Postures, q: Floats) -> Postures:
    """Postures at q (M, n) under conditions like those before: joints are approached from both sides if any row was."""
    some, rng = np.arange(len(q)) % len(before), np.random.default_rng(3)
    approach = None if before.approach is None else rng.choice([-1.0, 1.0], q.shape)
    delta_t = None if before.delta_t is None else np.full(len(q), np.median(before.delta_t))
    loads = (None if part is None else part[some] for part in (before.payload, before.payload_at, before.currents))
    return Postures(q, approach, delta_t, *loads)


def _unit(vectors: Floats) -> Floats:
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12))
