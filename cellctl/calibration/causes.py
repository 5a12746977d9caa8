"""Why rows do not see what they do not see: the plain causes, each with rows as they would be without it.

A joint that never moves, one orientation, a condition that never changes, no length, a single point. Whether such a
cause hides a combination of parameters is no matter of opinion: the same rows without it show the combination, or not.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import final

import numpy as np

from cellctl.calibration.elsewhere import brought, lines, moved, thinned, under
from cellctl.calibration.rows import Measured, SocketRows, SpacingRows, TouchRows
from cellctl.calibration.unknowns import State, Unknowns
from cellctl.kinematics import Bools, Floats, rotation_vector

STILL_DEG = 0.1
"""A joint that covers less never moves: a controller's last digits."""

HARDLY_DEG = 20.0
"""A joint that covers less moves by so much only; an orientation that changes by less changes by so much only."""

SAME_DEG = 1.0
"""Orientations nearer than this to each other are one."""

ONE_AXIS = 0.02
"""Turns about other axes are smaller than this share of those about the main one: there is one axis."""

MOVED_RAD = 0.8
"""By how much joints are supposed to have moved."""

LENGTH_SIGMA_MM = 0.01
LENGTHLESS = "no row has a length in it, so the robot's size is not seen"

APART = 0.3
"""How far a second point is supposed to be from the first, as a share of that one's distance from the base."""

SPHERE_MM = 150.0
"""What is nearer to its point than this touches a sphere; a ball-bar or a draw-wire is longer."""

_POINTS = TouchRows | SocketRows


@final
@dataclass(frozen=True, eq=False)
class Cause:
    """words: `joint 3 never moves in these rows`. lines: how rows without this cause move with the free unknowns
    (K, F), in their σ per tolerance. of_frames: whether it only hides what is about base, tool or points.
    """

    words: str
    lines: Callable[[], Floats]
    of_frames: bool = False


@final
@dataclass(frozen=True, eq=False)
class Rowed:
    """Rows of a fit, with its unknowns where they start."""

    unknowns: Unknowns
    blocks: tuple[Measured, ...]
    spacings: SpacingRows | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "blocks", tuple(block for block in self.blocks if len(block)))

    @property
    def state(self) -> State:
        """Robot and points where they start."""
        return self.unknowns.start

    @property
    def q(self) -> Floats:
        """Angles (M, n) of all rows, rad."""
        return np.concatenate([block.q for block in self.blocks])

    def as_they_are(self) -> Floats:
        """Lines of some of the rows."""
        return self.otherwise(lambda block: block)()

    def otherwise(self, change: Callable[[Measured], Measured]) -> Callable[[], Floats]:
        """Lines of the rows as `change` makes each block."""
        return lambda: lines(self.unknowns, [change(thinned(block)) for block in self.blocks])

    @property
    def lengthless(self) -> bool:
        """Whether nothing but visits to sockets was measured, and nobody knows how far these are apart."""
        return self.spacings is None and all(isinstance(block, SocketRows) for block in self.blocks)

    def points(self) -> list[int]:
        """The points that are visited."""
        return sorted({int(point) for block in self.blocks if isinstance(block, _POINTS) for point in block.point})


def causes(rows: Rowed) -> Iterator[Cause]:
    """What may hide something in these rows, single things before those that change many at once."""
    if rows.blocks:
        yield from _conditions(rows)
        yield from _points(rows)
        yield from _one_orientation(rows)
        yield from _joints(rows)
        yield from _one_axis(rows)
        yield from _lengthless(rows)


def any_posture(rows: Rowed) -> Floats:
    """Lines of rows of the same kinds at all sorts of postures and conditions: what these do not show, nothing does."""
    everywhere = np.ones(rows.q.shape[1], bool)
    return rows.otherwise(lambda block: _varied(moved(block, rows.state, everywhere, MOVED_RAD)))()


def _varied(block: Measured) -> Measured:
    rng = np.random.default_rng(0)
    sides, count = rng.choice([-1.0, 1.0], block.q.shape), len(block)
    return under(block, approach=sides, warmer=rng.uniform(-10, 10, count), payload=rng.uniform(0, 5, count))


def _joints(rows: Rowed) -> Iterator[Cause]:
    """Joints that do not move, and those that hardly do."""
    covered = np.rad2deg(np.ptp(rows.q, axis=0))
    still, hardly = covered < STILL_DEG, (covered >= STILL_DEG) & (covered < HARDLY_DEG)
    if still.any():
        words = f"{_listed('joint', still)} never move{'s' if still.sum() == 1 else ''} in these rows"
        yield _with_joints(rows, words, still)
    if hardly.any():
        few = [f"{covered[joint]:.2g}°" for joint in np.flatnonzero(hardly)]
        verb = "moves" if hardly.sum() == 1 else "move"
        yield _with_joints(rows, f"{_listed('joint', hardly)} {verb} by {', '.join(few)} only", hardly)


def _with_joints(rows: Rowed, words: str, joints: Bools) -> Cause:
    return Cause(words, rows.otherwise(lambda block: moved(block, rows.state, joints, MOVED_RAD)))


def _conditions(rows: Rowed) -> Iterator[Cause]:
    """Approach, payload and temperature that never change, or that nobody noted."""
    sides = _noted(rows, "approach")
    if sides is None or not _both(sides).all():
        yield Cause(_one_sided(sides), rows.otherwise(_from_either_side))
    for name, noun in (("payload", "payload"), ("warmer", "temperature")):
        values = _noted(rows, name)
        if values is None or np.ptp(values) == 0.0:
            words = f"no row says its {noun}" if values is None else f"the {noun} never changes in these rows"
            yield Cause(words, rows.otherwise(partial(_varying, name)))


def _both(sides: Floats) -> Bools:
    """Which joints (n,) came from both sides."""
    return np.asarray((sides > 0).any(axis=0) & (sides < 0).any(axis=0))


def _one_sided(sides: Floats | None) -> str:
    if sides is None:
        return "no row says from which side its joints came"
    if not _both(sides).any():
        return "every row was approached from the same side"
    return f"{_listed('joint', ~_both(sides))} always came from the same side"


def _noted(rows: Rowed, condition: str) -> Floats | None:
    """A condition of all rows that have it; None where none has."""
    noted = [getattr(block.postures, condition) for block in rows.blocks]
    values = [each for each in noted if each is not None]
    return np.concatenate(values) if values else None


def _from_either_side(block: Measured) -> Measured:
    return under(block, approach=np.random.default_rng(0).choice([-1.0, 1.0], block.q.shape))


def _varying(condition: str, block: Measured) -> Measured:
    """The rows with a condition from 0 to 5, in no order that the postures have."""
    return under(block, **{condition: np.random.default_rng(0).permutation(np.linspace(0.0, 5.0, len(block)))})


def _points(rows: Rowed) -> Iterator[Cause]:
    """A single fixed point, or several without a length."""
    points = rows.points()
    if len(points) == 1 and all(isinstance(block, _POINTS) for block in rows.blocks):
        yield Cause(f"all rows are {_where(rows.blocks)}", lambda: _at_second_point(rows))
    elif points and rows.lengthless:
        pair = SpacingRows(np.array([points[:2]]), np.zeros(1), np.full((1, 1), LENGTH_SIGMA_MM))
        yield Cause(LENGTHLESS, lambda: lines(rows.unknowns, [pair]))


def _lengthless(rows: Rowed) -> Iterator[Cause]:
    """No length where all rows are at one point, whose distance from another nobody can know."""
    if len(rows.points()) == 1 and rows.lengthless:
        yield Cause(LENGTHLESS, rows.otherwise(lambda block: _on_a_bar(block, rows.state)))


def _on_a_bar(block: Measured, state: State) -> Measured:
    """The rows with the tool away from its socket, and how far measured."""
    assert isinstance(block, SocketRows)
    there = replace(block.postures, q=block.q + np.random.default_rng(0).uniform(-MOVED_RAD, MOVED_RAD, block.q.shape))
    far = np.linalg.norm(state.models[block.session].tip(there) - state.points[block.point], axis=1)
    return TouchRows(there, block.point, far, np.full((len(block), 1), LENGTH_SIGMA_MM), block.session)


def _where(blocks: Sequence[Measured]) -> str:
    if all(isinstance(block, SocketRows) for block in blocks):
        return "in one socket"
    reach = max(float(block.reach.max()) for block in blocks if isinstance(block, TouchRows))
    return "on one sphere" if reach < SPHERE_MM else "about one point"


def _at_second_point(rows: Rowed) -> Floats:
    """Lines of the same rows at another point, with that point's own unknown place worked out of them."""
    point, free = rows.points()[0], np.flatnonzero(rows.unknowns.free)
    first = rows.state.points[point]
    away = APART * float(np.linalg.norm(first - rows.state.model.chain.base_now[:3, 3]))
    found = [np.zeros((0, free.size))]
    for direction in np.vstack([np.eye(3), -np.eye(3)]):
        there = replace(rows.state, points=np.where(np.arange(len(rows.state.points))[:, None] == point,
                                                    first + away * direction, rows.state.points))  # fmt: skip
        shifted = [_shifted(thinned(block), there, away * direction) for block in rows.blocks]
        moves = lines(replace(rows.unknowns, start=there, free=np.ones_like(rows.unknowns.free)), shifted)
        own = rows.state.points_at + 3 * point + np.arange(3)
        tied = np.linalg.qr(moves[:, own])[0] if len(moves) > 3 else moves[:, :0]
        moves[:, own] = 0.0
        found.append((moves - tied @ (tied.T @ moves))[:, free])
    return np.concatenate(found)


def _shifted(block: Measured, state: State, by: Floats) -> Measured:
    """The rows with their tips elsewhere by (3,), mm."""
    model = state.models[block.session]
    everywhere = np.ones(model.n, bool)
    return brought(block, model, block.q, model.tip(block.postures) + by, everywhere)


def _one_orientation(rows: Rowed) -> Iterator[Cause]:
    """One orientation of the tool in all rows, or nearly."""
    greatest = np.rad2deg(max(float(np.linalg.norm(_turns(rows.state, block), axis=1).max()) for block in rows.blocks))
    if greatest < HARDLY_DEG:
        few = f"orientation changes by {greatest:.2g}° only"
        yield _turned_elsewhere(rows, "orientation never changes in these rows" if greatest < SAME_DEG else few)


def _one_axis(rows: Rowed) -> Iterator[Cause]:
    """Turns of the tool about one axis only."""
    shape = np.linalg.svd(np.concatenate([_turns(rows.state, block) for block in rows.blocks]), compute_uv=False)
    if shape.size > 1 and shape[1] < ONE_AXIS * shape[0]:
        yield _turned_elsewhere(rows, "orientation changes about one axis only")


def _turned_elsewhere(rows: Rowed, words: str) -> Cause:
    everywhere = np.ones(rows.q.shape[1], bool)
    change = rows.otherwise(lambda block: moved(block, rows.state, everywhere, MOVED_RAD))
    return Cause(words, change, of_frames=True)


def _turns(state: State, block: Measured) -> Floats:
    """Turns (N, 3) of the tool from its orientation in the block's first row, rad."""
    pose = state.models[block.session].pose(block.postures)[:, :3, :3]
    return rotation_vector(np.matmul(pose, pose[0].T))


def _listed(noun: str, which: Bools) -> str:
    """`joint 3`, `joints 2, 5`."""
    numbers = [str(number + 1) for number in np.flatnonzero(which)]
    return f"{noun}{'s' if len(numbers) > 1 else ''} {', '.join(numbers)}"
