"""Reasons for unobservable parameters, each with the rows as they would be without it: postures, points, planes.

A joint that never moves, one orientation, a condition that never changes, no length, a single point. A test decides
whether a reason hides a combination of parameters: the same rows without the reason show the combination, or not.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import final

import numpy as np

from cellctl.calibration.effects.motor_torsion import VARIES_A
from cellctl.calibration.model.unknowns import State, Unknowns
from cellctl.calibration.observability.other_postures import brought, lines, moved, thinned, under
from cellctl.calibration.rows import Measured, SpacingRows, TouchRows
from cellctl.calibration.rows.fixed_points import planes_of, pole_of
from cellctl.kinematics import MM_PER_M, Bools, Floats, rotation_vector

MOVED_RAD = 0.8
"""Joints are imagined to move by up to so much, rad, 46° to either side: what a person would do, within most joints'
limits. Observability grows with it, and a reason counts only from `OBSERVABLE_SIGMAS` on."""

TURNS = 20_000
"""Rows of a block, at most, that decide whether orientation changes: a limit of time alone."""

SPHERE_MM = 150.0
"""A row nearer to its point than this touches a sphere; a ball-bar or a draw-wire is longer."""

APART = 0.3
"""Assumed distance of a second point from the first, as a share of the first one's distance from the base."""

LENGTH_SIGMA_MM = 0.01
"""1 σ of an imagined length, as a good certificate states it: would it make the combination observable?"""
LENGTHLESS = "no row has a length in it, so the robot's size is not seen"

STEP_MM = 200.0
"""Height of the step, known exactly, that gives a plane a length."""

STILL_DEG = 0.1
"""A joint with a smaller range does not move: a controller's last digits. For a prismatic joint 1° here and below is
17 mm, as its coordinate is m: on an arm of a metre both move the TCP alike."""

HARDLY_DEG = 20.0
"""A joint or an orientation with a smaller range is reported with that range."""

SAME_DEG = 1.0
"""Orientations nearer than this to each other are one."""

ONE_AXIS = 0.02
"""Turns about other axes are smaller than this share of those about the main one: there is only one axis."""


@final
@dataclass(frozen=True, eq=False)
class Reason:
    """words: `joint 3 never moves in these rows`. lines: derivative of rows without this reason by the free unknowns
    (K, F), in their σ per tolerance. of_frames: whether it only affects base, tool or points.
    """

    words: str
    lines: Callable[[], Floats]
    of_frames: bool = False


@final
@dataclass(frozen=True, eq=False)
class Rowed:
    """Rows of a fit, with its unknowns at their start."""

    unknowns: Unknowns
    blocks: tuple[Measured, ...]
    spacings: SpacingRows | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "blocks", tuple(block for block in self.blocks if len(block)))

    @property
    def state(self) -> State:
        """Robot and points at their start."""
        return self.unknowns.start

    @property
    def q(self) -> Floats:
        """Angles (M, n) of all rows, rad."""
        return np.concatenate([block.q for block in self.blocks])

    def as_they_are(self) -> Floats:
        """Lines of some of the rows."""
        return self.otherwise(lambda block: block)()

    def otherwise(self, change: Callable[[Measured], Measured]) -> Callable[[], Floats]:
        """Lines of the rows, each block changed by `change`."""
        return lambda: lines(self.unknowns, [change(thinned(block)) for block in self.blocks])

    @property
    def lengthless(self) -> bool:
        """Whether nothing but sockets and planes was measured, and no distance between sockets is known."""
        return self.spacings is None and not any(block.has_length for block in self.blocks)

    def points(self) -> list[int]:
        """The visited points, without planes."""
        at = [block.visited for block in self.blocks if not block.of_planes]
        return sorted({int(point) for points in at for point in points if point >= 0})

    @cached_property
    def turns(self) -> Floats:
        """Rotation vectors (M, 3) of the tool from its orientation in the first row of each session, rad; a sample of
        very many rows.
        """
        some = [block.pick(np.s_[:: 1 + len(block) // TURNS]) for block in self.blocks]
        poses = [self.state.models[block.session].pose(block.postures)[:, :3, :3] for block in some]
        first = {block.session: each[0] for block, each in zip(reversed(some), reversed(poses), strict=True)}
        turned = [np.matmul(each, first[block.session].T) for block, each in zip(some, poses, strict=True)]
        return np.concatenate([rotation_vector(each) for each in turned])


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
    longest = max(float(block.lengths(rows.state).max()) for block in rows.blocks if block.distances is not None)
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


def of_planes(rows: Rowed) -> Iterator[Reason]:
    """A single plane, or several without a length."""
    blocks = [block for block in rows.blocks if block.of_planes]
    planes = {int(index) for block in blocks for index in np.unique(block.visited)}
    if len(planes) == 1 and len(blocks) == len(rows.blocks):
        yield Reason("all rows are on one plane", lambda: _on_other_planes(rows, *planes))
    if planes and rows.lengthless:
        yield Reason(LENGTHLESS, rows.otherwise(lambda block: _on_a_step(block, rows.state)))


def _on_a_step(block: Measured, state: State) -> Measured:
    """The rows on the plane and on a step parallel to it, in turn."""
    if not block.of_planes:
        return block
    model, height = state.models[block.session], STEP_MM * (np.arange(len(block)) % 2)
    tcps = model.tcp(block.postures) + height[:, None] * block.normals(state)
    return brought(block, model, block.q, tcps, _all_joints(block))


def _on_other_planes(rows: Rowed, plane: int) -> Floats:
    """Lines of the same rows on planes across the first one, with the planes' own places eliminated."""
    from scipy.spatial.transform import Rotation  # at first use: it takes 0.2 s

    normal = planes_of(rows.state.points[plane])[0]
    found = [np.zeros((0, int(np.count_nonzero(rows.unknowns.free))))]
    blocks = [thinned(block) for block in rows.blocks]
    tcps = [rows.state.models[block.session].tcp(block.postures) for block in blocks]
    middle = np.concatenate(tcps).mean(axis=0)
    for axis in np.linalg.svd(normal[None])[2][1:]:
        turn = Rotation.from_rotvec(np.pi / 2.0 * axis)
        turned = turn.apply(normal)
        there = replace(rows.state, points=rows.state.points.copy())
        there.points[plane] = pole_of(turned, float(turned @ middle))
        moved = [
            _turned(block, there, middle + turn.apply(own - middle)) for block, own in zip(blocks, tcps, strict=True)
        ]
        found.append(lines_of_points_own(rows, there, moved, plane))
    return np.concatenate(found)


def _turned(block: Measured, state: State, tcps: Floats) -> Measured:
    return brought(block, state.models[block.session], block.q, tcps, _all_joints(block))


def _all_joints(block: Measured) -> Bools:
    return np.ones(block.q.shape[1], bool)


def reasons_for(rows: Rowed) -> Iterator[Reason]:
    """Possible reasons in these rows; those that change one thing first."""
    if rows.blocks:
        yield from _one_posture(rows)
        yield from _conditions(rows)
        yield from of_points(rows)
        yield from of_planes(rows)
        yield from _one_orientation(rows)
        yield from _joints(rows)
        yield from _one_axis(rows)
        yield from of_no_length(rows)


def any_posture(rows: Rowed) -> Floats:
    """Lines of rows of the same kinds at varied postures and conditions: the most that such rows can show."""
    everywhere = np.ones(rows.q.shape[1], bool)
    return rows.otherwise(lambda block: _varied(moved(block, rows.state, everywhere, MOVED_RAD)))()


def _varied(block: Measured) -> Measured:
    """The rows under conditions that a person could vary: ±10 °C, 0 to 5 kg, currents of σ 2 A."""
    rng = np.random.default_rng(0)
    sides, count = rng.choice([-1.0, 1.0], block.q.shape), len(block)
    delta_t, payload, currents = rng.uniform(-10, 10, count), rng.uniform(0, 5, count), rng.normal(0, 2, block.q.shape)
    return under(block, approach=sides, delta_t=delta_t, payload=payload, currents=currents)


def _one_posture(rows: Rowed) -> Iterator[Reason]:
    """All rows at one posture, or nearly."""
    if np.rad2deg(np.ptp(rows.q, axis=0)).max() < STILL_DEG:
        yield _with_joints(rows, "all rows are at one posture", np.ones(rows.q.shape[1], bool))


def _joints(rows: Rowed) -> Iterator[Reason]:
    """Joints that do not move, and those that hardly do."""
    covered = np.rad2deg(np.ptp(rows.q, axis=0))
    still, hardly = covered < STILL_DEG, (covered >= STILL_DEG) & (covered < HARDLY_DEG)
    if still.any():
        words = f"{_listed('joint', still)} never move{'s' if still.sum() == 1 else ''} in these rows"
        yield _with_joints(rows, words, still)
    if hardly.any():
        slides = rows.state.model.chain.prismatic
        mm = MM_PER_M * np.deg2rad(covered)
        few = [f"{mm[at]:.3g} mm" if slides[at] else f"{covered[at]:.2g}°" for at in np.flatnonzero(hardly)]
        verb = "moves" if hardly.sum() == 1 else "move"
        yield _with_joints(rows, f"{_listed('joint', hardly)} {verb} by {', '.join(few)} only", hardly)


def _with_joints(rows: Rowed, words: str, joints: Bools) -> Reason:
    return Reason(words, rows.otherwise(lambda block: moved(block, rows.state, joints, MOVED_RAD)))


def _conditions(rows: Rowed) -> Iterator[Reason]:
    """Approach, payload, temperature and currents that never change, or were not recorded."""
    sides = _noted(rows, "approach")
    if sides is None or not _both(sides).all():
        yield Reason(_one_sided(sides), rows.otherwise(_from_either_side))
    for name, noun in (("payload", "payload"), ("delta_t", "temperature")):
        values = _noted(rows, name)
        if values is None or np.ptp(values) == 0.0:
            words = f"no row says its {noun}" if values is None else f"the {noun} never changes in these rows"
            yield Reason(words, rows.otherwise(partial(_varying, name)))
    currents = _noted(rows, "currents")
    if currents is not None and (same := np.ptp(currents, axis=0) < VARIES_A).any():
        words = f"the motor current of {_listed('joint', same)} never changes in these rows"
        yield Reason(words, rows.otherwise(_other_currents))


def _both(sides: Floats) -> Bools:
    """Which joints (n,) were approached from both sides."""
    return np.asarray((sides > 0).any(axis=0) & (sides < 0).any(axis=0))


def _one_sided(sides: Floats | None) -> str:
    if sides is None:
        return "no row says from which side its joints came"
    if not _both(sides).any():
        return "every row was approached from the same side"
    return f"{_listed('joint', ~_both(sides))} always came from the same side"


def _noted(rows: Rowed, condition: str) -> Floats | None:
    """A condition, from all rows that have it; None where no row has it."""
    noted = [getattr(block.postures, condition) for block in rows.blocks]
    values = [each for each in noted if each is not None]
    return np.concatenate(values) if values else None


def _from_either_side(block: Measured) -> Measured:
    return under(block, approach=np.random.default_rng(0).choice([-1.0, 1.0], block.q.shape))


def _varying(condition: str, block: Measured) -> Measured:
    """The rows with a condition (°C, or kg) from 0 to 5, in an order independent of the postures."""
    return under(block, **{condition: np.random.default_rng(0).permutation(np.linspace(0.0, 5.0, len(block)))})


def _other_currents(block: Measured) -> Measured:
    return under(block, currents=np.random.default_rng(0).normal(0.0, 2.0, block.q.shape))


def _one_orientation(rows: Rowed) -> Iterator[Reason]:
    """One orientation of the tool in all rows, or nearly."""
    greatest = np.rad2deg(float(np.linalg.norm(rows.turns, axis=1).max()))
    if greatest < HARDLY_DEG:
        few = f"orientation changes by {greatest:.2g}° only"
        yield _turned_elsewhere(rows, "orientation never changes in these rows" if greatest < SAME_DEG else few)


def _one_axis(rows: Rowed) -> Iterator[Reason]:
    """Turns of the tool about one axis only."""
    shape = np.linalg.svd(rows.turns, compute_uv=False)
    if shape.size > 1 and shape[1] < ONE_AXIS * shape[0]:
        yield _turned_elsewhere(rows, "orientation changes about one axis only")


def _turned_elsewhere(rows: Rowed, words: str) -> Reason:
    everywhere = np.ones(rows.q.shape[1], bool)
    change = rows.otherwise(lambda block: moved(block, rows.state, everywhere, MOVED_RAD))
    return Reason(words, change, of_frames=True)


def _listed(noun: str, which: Bools) -> str:
    """`joint 3`, `joints 2, 5`."""
    numbers = [str(number + 1) for number in np.flatnonzero(which)]
    return f"{noun}{'s' if len(numbers) > 1 else ''} {', '.join(numbers)}"
