"""Reasons for unobservable parameters, each with the rows as they would be without it.

A joint that never moves, one orientation, a condition that never changes, no length, a single point. A test decides
whether a reason hides a combination of parameters: the same rows without the reason show the combination, or not.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from cellctl.calibration.effects.motor_torsion import VARIES_A
from cellctl.calibration.observability.other_postures import moved, under
from cellctl.calibration.observability.plane_reasons import of_planes
from cellctl.calibration.observability.point_reasons import of_no_length, of_points
from cellctl.calibration.observability.reason import MOVED_RAD, Reason, Rowed
from cellctl.calibration.rows import Measured
from cellctl.kinematics import Bools, Floats

STILL_DEG = 0.1
"""A joint with a smaller range does not move: a controller's last digits."""

HARDLY_DEG = 20.0
"""A joint or an orientation with a smaller range is reported with that range."""

SAME_DEG = 1.0
"""Orientations nearer than this to each other are one."""

ONE_AXIS = 0.02
"""Turns about other axes are smaller than this share of those about the main one: there is only one axis."""


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
        few = [f"{covered[joint]:.2g}°" for joint in np.flatnonzero(hardly)]
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
    """The rows with a condition from 0 to 5, in an order independent of the postures."""
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
