"""Joints that turn the other way, or count from another zero."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self, final

import numpy as np

from cellctl.calibration.estimation.estimate import estimate
from cellctl.calibration.mistakes.case import Case
from cellctl.calibration.mistakes.joint_search import ROWS, rough_sizes
from cellctl.calibration.mistakes.misfit import misfit, steps_of
from cellctl.calibration.mistakes.supposition import Change, Supposition
from cellctl.calibration.rows import PoseRows, PositionRows
from cellctl.kinematics import Floats

LEAST_OFFSET_DEG = 2.0
"""A zero that is off by less is a mastering error: for the identification, not for the robot file."""

RIGHT_ANGLE_DEG = 1.0
"""This near to a right angle, or several, an offset is one."""

GRID_DEG = 30.0
"""Between suppositions of an offset: tool positions are linear in its cosine and sine, so that a valley is wide."""

AT_ONCE = 3
"""Joints that are looked for at once."""

BREADTH = 10
"""Pairs that the search for a third joint goes on from."""

REFINED = 6
"""Suppositions on the grid whose angles are worked out."""

SMALL_DEG = 10.0
"""An offset near none is looked for from here."""

SEARCHED = 60
"""Rows that the angles are worked out from."""

LOOSE_DEG = 60.0
"""Prior 1 σ of an offset that is worked out: as good as nothing known."""


@final
@dataclass(frozen=True, eq=False)
class _Joints:
    """Reversed joints (n,), as −1, and offsets (n,), deg, besides what the robot file says."""

    sign: Floats
    offset: Floats

    @classmethod
    def of(cls, n: int, joints: Sequence[int], ways: Sequence[tuple[float, float]]) -> Self:
        """`joints` with a sign and an offset each, the others as they are."""
        sign, offset = np.ones(n), np.zeros(n)
        for joint, (way, angle) in zip(joints, ways, strict=True):
            sign[joint], offset[joint] = way, angle
        return cls(sign, offset)

    def applied(self, case: Case) -> Case:
        """The case with these."""
        return case.with_joints(case.joints.sign * self.sign, case.joints.offset + self.offset)

    def and_with(self, joint: int, sign: float, offset: float) -> Self:
        """These with one joint otherwise."""
        signs, offsets = self.sign.copy(), self.offset.copy()
        signs[joint], offsets[joint] = sign, offset
        return replace(self, sign=signs, offset=offsets)

    @property
    def oddity(self) -> int:
        """Few joints before many; reversed ones before right angles before any angles."""
        angles = [offset for offset in self.offset.tolist() if offset]
        both = np.count_nonzero((self.sign < 0.0) & (self.offset != 0.0))
        return 10 * len(self.changed()) + sum(1 if angle % 90.0 == 0.0 else 3 for angle in angles) + int(both)

    @property
    def mastering(self) -> bool:
        """Whether they say no more than that zeros are off by little."""
        return bool(np.all(self.sign > 0.0) and np.all(np.abs(self.offset) < LEAST_OFFSET_DEG))

    def changed(self) -> Any:
        """Which joints are not as the robot file says."""
        return np.flatnonzero((self.sign < 0.0) | (self.offset != 0.0))


def plain_joints(case: Case) -> Iterator[Supposition]:
    """The most promising of: any joints reversed (of robots with more than seven: three), one or two off by right
    angles.
    """
    reversed_ = [
        _Joints.of(case.n, joints, [(-1.0, 0.0)] * count)
        for count in range(1, (case.n if case.n <= 7 else AT_ONCE) + 1)
        for joints in itertools.combinations(range(case.n), count)
    ]
    ways = [(sign, angle) for sign in (1.0, -1.0) for angle in (90.0, -90.0, 180.0)] + [(-1.0, 0.0)]
    for joints in _best(case, [*reversed_, *_singles(case, ways), *_doubles(case, ways)])[: 2 * REFINED]:
        yield _supposed(case, joints)


def reversed_joint(case: Case) -> Iterator[Supposition]:
    """One joint reversed."""
    for joint in range(case.n):
        yield _supposed(case, _Joints.of(case.n, [joint], [(-1.0, 0.0)]))


def offset_joint(case: Case) -> Iterator[Supposition]:
    """One joint off by any angle, reversed besides or not."""
    yield from _worked_out(case, _best(case, _singles(case, _ways()))[:REFINED])


def two_joints(case: Case) -> Iterator[Supposition]:
    """Two joints off by any angle, reversed besides or not."""
    yield from _worked_out(case, _by_joints(case, _doubles(case, _ways()))[: 2 * REFINED])


def three_joints(case: Case) -> Iterator[Supposition]:
    """A third joint besides the best pairs."""
    pairs = _by_joints(case, _doubles(case, _ways()))[:BREADTH]
    threes = [
        pair.and_with(joint, *way)
        for pair in pairs
        for joint in sorted(set(range(case.n)) - set(pair.changed().tolist()))
        for way in _ways()
    ]
    yield from _worked_out(case, _by_joints(case, threes)[: 2 * REFINED])


def _ways() -> list[tuple[float, float]]:
    """What one joint may be besides right: a sign and an offset."""
    angles = np.arange(-180.0, 180.0, GRID_DEG).tolist()
    turned = [angle for angle in angles if angle] + [SMALL_DEG, -SMALL_DEG]
    return [*((1.0, angle) for angle in turned), *((-1.0, angle) for angle in angles)]


def _singles(case: Case, ways: list[tuple[float, float]]) -> list[_Joints]:
    return [_Joints.of(case.n, [joint], [way]) for joint in range(case.n) for way in _seen(case, joint, ways)]


def _doubles(case: Case, ways: list[tuple[float, float]]) -> list[_Joints]:
    return [
        _Joints.of(case.n, (first, second), two)
        for first, second in itertools.combinations(range(case.n), 2)
        for two in itertools.product(_seen(case, first, ways), _seen(case, second, ways))
    ]


def _seen(case: Case, joint: int, ways: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Those of `ways` that these rows can tell: another zero of the first joint is another heading of base or points,
    one of the last another turn of a tool that is registered. That harms nothing, and nobody is told of it.
    """
    instrument = case.task.rows.kinds & {PositionRows, PoseRows}
    of_base = joint == 0 and (not instrument or "base" in case.task.registered)
    if of_base or (joint == case.n - 1 and instrument and "tool" in case.task.registered):
        return [(sign, angle) for sign, angle in ways if angle == 0.0]
    return ways


def _best(case: Case, many: list[_Joints]) -> list[_Joints]:
    """By how near they bring nominal to a few rows, roughly; the simplest of equals first."""
    sizes = _sizes(case, many)
    odd = np.array([joints.oddity for joints in many])
    return [many[place] for place in np.lexsort((sizes, odd, steps_of(sizes)))]


def _by_joints(case: Case, many: list[_Joints]) -> list[_Joints]:
    """For each set of joints and signs the nearest, the nearest of these first: the grid is too coarse for more."""
    best: dict[tuple[int, ...], _Joints] = {}
    for place in np.argsort(_sizes(case, many), kind="stable"):
        joints = many[place]
        best.setdefault((*joints.sign.astype(int).tolist(), *joints.changed().tolist()), joints)
    return list(best.values())


def _sizes(case: Case, many: list[_Joints]) -> Floats:
    signs, offsets = (np.array([getattr(joints, part) for joints in many]) for part in ("sign", "offset"))
    return rough_sizes(case.thinned(ROWS), signs, offsets)


def _worked_out(case: Case, rough: list[_Joints]) -> Iterator[Supposition]:
    few = case.thinned(SEARCHED)
    for joints in rough:
        yield _supposed(case, _refined(few, _refined(few, joints)))


def _refined(few: Case, joints: _Joints) -> _Joints:
    """Offsets worked out together with the registration, on the rows that fit best with those given."""
    supposed = joints.applied(few)
    about = misfit(supposed, rounds=2)
    blocks = [block.pick(kept) for block, kept in zip(supposed.task.rows.blocks, about.kept, strict=True)]
    unknowns = supposed.task.unknowns(about.state)
    loose = np.array([each.group == "zeros" and bool(joints.offset[each.joint - 1]) for each in unknowns.parameters])
    sigma = np.where(loose, np.deg2rad(LOOSE_DEG), unknowns.sigma)
    free = loose | supposed.task.registration(unknowns)
    found = estimate(replace(unknowns, sigma=sigma, prior=None, free=free), blocks)
    offset = joints.offset.copy()
    for place in np.flatnonzero(loose):
        turn, joint = float(np.rad2deg(found.deviations[place])), unknowns.parameters[place].joint - 1
        offset[joint] = _rounded((offset[joint] + turn + 180.0) % 360.0 - 180.0)
    return replace(joints, offset=offset)


def _rounded(offset: float) -> float:
    """None, or right angles, where an offset is nearly that: exactly."""
    right = 90.0 * round(offset / 90.0)
    return (right + 180.0) % 360.0 - 180.0 if abs(offset - right) < RIGHT_ANGLE_DEG else offset


def _supposed(case: Case, joints: _Joints) -> Supposition:
    changed = joints.changed()
    changes = tuple(_change(case, int(joint), joints) for joint in changed)
    return Supposition(changes, joints.applied(case), joints.oddity, joints.mastering)


def _change(case: Case, joint: int, joints: _Joints) -> Change:
    name, offset = f"A{joint + 1}", float(joints.offset[joint])
    flipped = joints.sign[joint] < 0.0
    sign = f"sign: {int(case.joints.sign[joint] * joints.sign[joint])}"
    total = (case.joints.offset[joint] + offset + 180.0) % 360.0 - 180.0
    zero = f"offset: {total:.1f}".removesuffix(".0")
    of_joint = f" for joint {joint + 1}"
    if not offset:
        return Change(f"{name} reversed", "robot", sign + of_joint, ("joints", joint, "sign"))
    if flipped:
        what = f"{name} reversed and off by {abs(offset):.1f}°"
        return Change(what, "robot", f"{sign} and {zero}{of_joint}", ("joints", joint, "sign"))
    return Change(f"{name} off by {abs(offset):.1f}°", "robot", zero + of_joint, ("joints", joint, "offset"))
