"""Hypotheses about reversed joints and joints with another zero, one to three of them, screened roughly and fitted.

For an instrument's rows base and tool are found by a linear problem in which the base may be any affine map (see
`registration`); points always have linear problems. Each is solved for all hypotheses in one batch, and a
second time on the rows that fit best.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self, final

import numpy as np

from cellctl.calibration.model.unknowns import PLACED
from cellctl.calibration.rows import Measured
from cellctl.calibration.rows.fixed_points import least_squares
from cellctl.calibration.solver.estimate import estimate
from cellctl.kinematics import Floats
from cellctl.setup_check.hypothesis import Change, Hypothesis, Setup
from cellctl.setup_check.misfit import CORE, misfit, steps_of

LEAST_OFFSET_DEG = 2.0
"""A smaller error of a zero is a mastering error: for the identification, not for the robot file."""

RIGHT_ANGLE_DEG = 1.0
"""An offset this near to a multiple of 90° is rounded to it."""

ROWS = 40
CHUNK = 256
GRID_DEG = 30.0
"""Step between tested offsets: TCP positions are linear in its cosine and sine, so that a local optimum is wide."""

AT_ONCE = 3
"""Joints that are searched at once."""

BREADTH = 10
"""Pairs from which the search for a third joint starts."""

REFINED = 6
"""Hypotheses on the grid whose angles are fitted."""

SMALL_DEG = 10.0
"""Start value of the search for a small offset."""

SEARCHED = 60
"""Rows to which the angles are fitted."""

REVERSED = (-1.0, 0.0)
"""A joint with the other sign and no offset."""

LOOSE_DEG = 60.0
"""Prior 1 σ of an offset that is fitted: practically free."""


@final
@dataclass(frozen=True, eq=False)
class JointChanges:
    """Reversed joints (n,), as −1, and offsets (n,), deg, to be added to those of the robot file."""

    sign: Floats
    offset: Floats

    @classmethod
    def of(cls, n: int, joints: Sequence[int], ways: Sequence[tuple[float, float]]) -> Self:
        """`joints` with a sign and an offset each, the others unchanged."""
        sign, offset = np.ones(n), np.zeros(n)
        for joint, (way, angle) in zip(joints, ways, strict=True):
            sign[joint], offset[joint] = way, angle
        return cls(sign, offset)

    def applied(self, setup: Setup) -> Setup:
        """The set-up with these changes."""
        return setup.with_joints(setup.joints.sign * self.sign, setup.joints.offset + self.offset)

    def and_with(self, joint: int, sign: float, offset: float) -> Self:
        """These changes, and a sign and an offset for one more joint."""
        signs, offsets = self.sign.copy(), self.offset.copy()
        signs[joint], offsets[joint] = sign, offset
        return replace(self, sign=signs, offset=offsets)

    def with_offset(self, joint: int, offset: float) -> Self:
        """These changes with another offset, deg, of one joint; exactly a multiple of 90° where it is near one."""
        right = 90.0 * round(offset / 90.0)
        offset = right if abs(offset - right) < RIGHT_ANGLE_DEG else offset
        return self.and_with(joint, float(self.sign[joint]), _half_turn(offset))

    @property
    def complexity(self) -> int:
        """Few joints before many; reversed joints before right angles before other angles."""
        angles = [offset for offset in self.offset.tolist() if offset]
        both = np.count_nonzero((self.sign < 0.0) & (self.offset != 0.0))
        return 10 * len(self.changed()) + sum(1 if angle % 90.0 == 0.0 else 3 for angle in angles) + int(both)

    @property
    def mastering(self) -> bool:
        """Whether these are small offsets of joint zeros only."""
        return bool(np.all(self.sign > 0.0) and np.all(np.abs(self.offset) < LEAST_OFFSET_DEG))

    def changed(self) -> Any:
        """Which joints are changed."""
        return np.flatnonzero((self.sign < 0.0) | (self.offset != 0.0))

    def hypothesis(self, setup: Setup) -> Hypothesis:
        """These changes, in words and applied to `setup`."""
        changes = tuple(self._change(setup, int(joint)) for joint in self.changed())
        return Hypothesis(changes, self.applied(setup), self.complexity, self.mastering)

    def _change(self, setup: Setup, joint: int) -> Change:
        offset, number = float(self.offset[joint]), joint + 1
        words, cures = [], []
        if self.sign[joint] < 0.0:
            words.append("reversed")
            cures.append(f"sign: {-int(setup.joints.sign[joint])}")
        if offset:
            words.append(f"off by {abs(offset):.1f}°")
            cures.append(f"offset: {_half_turn(setup.joints.offset[joint] + offset):.1f}".removesuffix(".0"))
        key = "sign" if self.sign[joint] < 0.0 else "offset"
        cure = f"{' and '.join(cures)} for joint {number}"
        return Change(f"A{number} {' and '.join(words)}", "robot", cure, ("joints", joint, key))


def _half_turn(angle: float) -> float:
    """The angle, deg, from −180 up to 180."""
    return float((angle + 180.0) % 360.0 - 180.0)


def rough_sizes(setup: Setup, sign: Floats, offset: Floats) -> Floats:
    """RMS over the nearest rows (C,), mm, with joints reversed by `sign` (C, n), ±1, and changed by `offset` (C, n),
    deg.

    Uses all rows of the set-up: thin it before.
    """
    parts = [np.s_[start : start + CHUNK] for start in range(0, len(sign), CHUNK)]
    return np.concatenate([np.zeros(0), *(_sizes_of_rows(setup, sign[part], offset[part]) for part in parts)])


def _sizes_of_rows(setup: Setup, sign: Floats, offset: Floats) -> Floats:
    signs, offsets = sign * setup.joints.sign, offset + setup.joints.offset
    q = setup.joints.in_model_units(signs[:, None] * setup.readings + offsets[:, None])
    squares, start = [], 0
    for block in setup.task.rows.blocks:
        if len(block):
            squares.append(_squares(setup, block, q[:, start : start + len(block)]))
        start += len(block)
    return np.asarray(np.sqrt(np.concatenate(squares, axis=1).mean(axis=1)))


def _squares(setup: Setup, block: Measured, q: Floats) -> Floats:
    """Squared distances (C, K) of a block's nearest rows."""
    chain = setup.task.model.chain
    if block.positions is None:
        return _nearest(block.squared_misfits(chain.forward(q)[..., :3, 3]))
    if setup.task.registered != PLACED:
        return _nearest(np.sum((chain.forward(q)[..., :3, 3] - block.positions) ** 2, axis=-1))
    return _of_instrument(chain.with_base(np.eye(4)).forward_flange(q), block.positions)


def _of_instrument(flange: Floats, xyz: Floats) -> Floats:
    """Squared distances (C, K) of the nearest rows, base relaxed."""
    middle = xyz - xyz.mean(axis=0)
    middle = middle / max(float(np.abs(middle).max()), 1e-9)
    lines = np.zeros((*flange.shape[:2], 3, 15))
    for axis in range(3):
        lines[:, :, axis, 3 * axis : 3 * axis + 3] = middle
        lines[:, :, axis, 9 + axis] = 1.0
    lines[..., 12:] = -flange[..., :3, :3]
    right = flange[..., :3, 3]
    squares = _squared_residuals(lines, right, lines, right)
    kept = np.argsort(squares, axis=1)[:, : int(np.ceil(CORE * len(xyz)))]
    near = np.take_along_axis(lines, kept[:, :, None, None], axis=1)
    return _nearest(_squared_residuals(near, np.take_along_axis(right, kept[:, :, None], axis=1), lines, right))


def _squared_residuals(lines: Floats, right: Floats, all_lines: Floats, all_right: Floats) -> Floats:
    """Squared residuals (C, N) of all lines for the solution from `lines`."""
    count = len(lines)
    found = least_squares(lines.reshape(count, -1, 15), right.reshape(count, -1))
    left = np.matmul(all_lines, found[:, None, :, None])[..., 0] - all_right
    return np.asarray(np.sum(left**2, axis=-1))


def _nearest(squares: Floats) -> Floats:
    return np.sort(squares, axis=1)[:, : int(np.ceil(CORE * squares.shape[1]))]


def plain_joints(setup: Setup) -> Iterator[Hypothesis]:
    """The most promising of: any joints reversed (of robots with more than seven: three), one or two off by right
    angles.
    """
    most = setup.n if setup.n <= 7 else AT_ONCE
    reversed_ = [joints for count in range(most) for joints in _combined(setup, count + 1, [REVERSED])]
    ways = [(sign, angle) for sign in (1.0, -1.0) for angle in (90.0, -90.0, 180.0)] + [REVERSED]
    for joints in _best(setup, [*reversed_, *_combined(setup, 1, ways), *_combined(setup, 2, ways)])[: 2 * REFINED]:
        yield joints.hypothesis(setup)


def reversed_joint(setup: Setup) -> Iterator[Hypothesis]:
    """One joint reversed."""
    for joints in _combined(setup, 1, [REVERSED]):
        yield joints.hypothesis(setup)


def offset_joint(setup: Setup) -> Iterator[Hypothesis]:
    """One joint with any offset, also reversed or not."""
    yield from _fitted(setup, _best(setup, _combined(setup, 1, _ways()))[:REFINED])


def two_joints(setup: Setup) -> Iterator[Hypothesis]:
    """Two joints with any offsets, also reversed or not."""
    yield from _fitted(setup, _by_joints(setup, _combined(setup, 2, _ways()))[: 2 * REFINED])


def three_joints(setup: Setup) -> Iterator[Hypothesis]:
    """A third joint added to the best pairs."""
    pairs = _by_joints(setup, _combined(setup, 2, _ways()))[:BREADTH]
    threes = [
        pair.and_with(joint, *way)
        for pair in pairs
        for joint in sorted(set(range(setup.n)) - set(pair.changed().tolist()))
        for way in _ways()
    ]
    yield from _fitted(setup, _by_joints(setup, threes)[: 2 * REFINED])


def _ways() -> list[tuple[float, float]]:
    """Possible errors of one joint: a sign and an offset."""
    angles = np.arange(-180.0, 180.0, GRID_DEG).tolist()
    turned = [angle for angle in angles if angle] + [SMALL_DEG, -SMALL_DEG]
    return [*((1.0, angle) for angle in turned), *((-1.0, angle) for angle in angles)]


def _combined(setup: Setup, count: int, ways: list[tuple[float, float]]) -> list[JointChanges]:
    """Each of `ways` for each of `count` joints, in all combinations."""
    return [
        JointChanges.of(setup.n, joints, chosen)
        for joints in itertools.combinations(range(setup.n), count)
        for chosen in itertools.product(*(_observable(setup, joint, ways) for joint in joints))
    ]


def _observable(setup: Setup, joint: int, ways: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Those of `ways` that these rows can show. Another zero of the first joint is equivalent to another heading of
    base or points; one of the last joint, to another rotation of a registered tool. Neither does harm. A prismatic
    joint may be reversed; its zero is found by the identification, however large.
    """
    instrument = bool(setup.task.rows.of_instrument.any())
    of_base = joint == 0 and (not instrument or "base" in setup.task.registered)
    if (
        of_base
        or not setup.revolute[joint]
        or (joint == setup.n - 1 and instrument and "tool" in setup.task.registered)
    ):
        return [(sign, angle) for sign, angle in ways if angle == 0.0]
    return ways


def _best(setup: Setup, many: list[JointChanges]) -> list[JointChanges]:
    """Sorted by nominal's rough distance from a few rows; the simplest of equals first."""
    sizes = _screened_sizes(setup, many)
    complexity = np.array([joints.complexity for joints in many])
    return [many[place] for place in np.lexsort((sizes, complexity, steps_of(sizes)))]


def _by_joints(setup: Setup, many: list[JointChanges]) -> list[JointChanges]:
    """The nearest for each set of joints and signs, sorted by distance: the grid is too coarse for more."""
    best: dict[tuple[int, ...], JointChanges] = {}
    for place in np.argsort(_screened_sizes(setup, many), kind="stable"):
        joints = many[place]
        best.setdefault((*joints.sign.astype(int).tolist(), *joints.changed().tolist()), joints)
    return list(best.values())


def _screened_sizes(setup: Setup, many: list[JointChanges]) -> Floats:
    signs, offsets = (np.array([getattr(joints, part) for joints in many]) for part in ("sign", "offset"))
    return rough_sizes(setup.thinned(ROWS), signs, offsets)


def _fitted(setup: Setup, rough: list[JointChanges]) -> Iterator[Hypothesis]:
    sample = setup.thinned(SEARCHED)
    for joints in rough:
        yield _refined(sample, _refined(sample, joints)).hypothesis(setup)


def _refined(sample: Setup, joints: JointChanges) -> JointChanges:
    """Offsets fitted together with the registration, on the rows that fit best with those given."""
    hypothesis = joints.applied(sample)
    about = misfit(hypothesis, rounds=2)
    blocks = [block.pick(kept) for block, kept in zip(hypothesis.task.rows.blocks, about.kept, strict=True)]
    unknowns = hypothesis.task.unknowns(about.state)
    loose = np.array([each.group == "zeros" and bool(joints.offset[each.joint - 1]) for each in unknowns.parameters])
    sigma = np.where(loose, np.deg2rad(LOOSE_DEG), unknowns.sigma)
    free = loose | hypothesis.task.registration_parameters(unknowns)
    found = estimate(replace(unknowns, sigma=sigma, prior=None, free=free), blocks)
    for place in np.flatnonzero(loose):
        turn, joint = float(np.rad2deg(found.deviations[place])), unknowns.parameters[place].joint - 1
        joints = joints.with_offset(joint, (joints.offset[joint] + turn + 180.0) % 360.0 - 180.0)
    return joints
