"""Reasons for unobservable parameters with fixed points: missing a second one, or a length."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from cellctl.calibration.model.unknowns import State
from cellctl.calibration.observability.other_postures import brought, lines, thinned
from cellctl.calibration.observability.reason import MOVED_RAD, Reason, Rowed
from cellctl.calibration.rows import Measured, SpacingRows, TouchRows
from cellctl.kinematics import Floats

SPHERE_MM = 150.0
"""A row nearer to its point than this touches a sphere; a ball-bar or a draw-wire is longer."""

APART = 0.3
"""Assumed distance of a second point from the first, as a share of the first one's distance from the base."""

LENGTH_SIGMA_MM = 0.01
LENGTHLESS = "no row has a length in it, so the robot's size is not seen"


def of_points(rows: Rowed) -> Iterator[Reason]:
    """A single fixed point, or several without a length."""
    points = rows.points()
    if len(points) == 1 and all((block.visited >= 0).all() and not block.of_planes for block in rows.blocks):
        yield Reason(f"all rows are {_where(rows)}", lambda: _at_second_point(rows))
    elif len(points) > 1 and rows.lengthless:
        pair = SpacingRows(np.array([points[:2]]), np.zeros(1), np.full((1, 1), LENGTH_SIGMA_MM))
        yield Reason(LENGTHLESS, lambda: lines(rows.unknowns, [pair]))


def of_no_length(rows: Rowed) -> Iterator[Reason]:
    """No length: all rows are at one point, without a known distance to another."""
    if len(rows.points()) == 1 and rows.lengthless and not any(block.of_planes for block in rows.blocks):
        yield Reason(LENGTHLESS, rows.otherwise(lambda block: _on_a_bar(block, rows.state)))


def _on_a_bar(block: Measured, state: State) -> Measured:
    """The rows with the tool away from its socket, at a measured distance."""
    there = replace(block.postures, q=block.q + np.random.default_rng(0).uniform(-MOVED_RAD, MOVED_RAD, block.q.shape))
    far = np.linalg.norm(state.models[block.session].tcp(there) - state.points[block.visited], axis=1)
    return TouchRows(there, block.visited, far, np.full((len(block), 1), LENGTH_SIGMA_MM), block.session)


def _where(rows: Rowed) -> str:
    if not any(block.has_length for block in rows.blocks):
        return "in one socket"
    longest = max(float(block.lengths(rows.state).max()) for block in rows.blocks if isinstance(block, TouchRows))
    return "on one sphere" if longest < SPHERE_MM else "about one point"


def _at_second_point(rows: Rowed) -> Floats:
    """Lines of the same rows at another point, with that point's own unknown place eliminated."""
    point = rows.points()[0]
    first = rows.state.points[point]
    away = APART * float(np.linalg.norm(first - rows.state.model.chain.base_now[:3, 3]))
    found = [np.zeros((0, int(np.count_nonzero(rows.unknowns.free))))]
    for direction in np.vstack([np.eye(3), -np.eye(3)]):
        there = replace(rows.state, points=np.where(np.arange(len(rows.state.points))[:, None] == point,
                                                    first + away * direction, rows.state.points))  # fmt: skip
        shifted = [_shifted(thinned(block), there, away * direction) for block in rows.blocks]
        found.append(lines_of_points_own(rows, there, shifted, point))
    return np.concatenate(found)


def lines_of_points_own(rows: Rowed, there: State, blocks: list[Measured], point: int) -> Floats:
    """Derivative of `blocks` by the free unknowns (K, F) at `there`, the place of `point` itself eliminated."""
    moves = lines(replace(rows.unknowns, start=there, free=np.ones_like(rows.unknowns.free)), blocks)
    own = rows.state.points_at + 3 * point + np.arange(3)
    tied = np.linalg.qr(moves[:, own])[0] if len(moves) > 3 else moves[:, :0]
    moves[:, own] = 0.0
    return np.asarray((moves - tied @ (tied.T @ moves))[:, rows.unknowns.free])


def _shifted(block: Measured, state: State, by: Floats) -> Measured:
    """The rows with their TCPs moved by (3,), mm."""
    model = state.models[block.session]
    everywhere = np.ones(model.n, bool)
    return brought(block, model, block.q, model.tcp(block.postures) + by, everywhere)
