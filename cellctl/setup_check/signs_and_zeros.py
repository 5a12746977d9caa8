"""Hypotheses about reversed joints and joints with another zero: one, two and three of them."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from cellctl.calibration.estimation.estimate import estimate
from cellctl.calibration.rows import PoseRows, PositionRows
from cellctl.kinematics import Floats
from cellctl.setup_check.hypothesis import Hypothesis, Setup
from cellctl.setup_check.joint_changes import JointChanges
from cellctl.setup_check.joint_screening import ROWS, rough_sizes
from cellctl.setup_check.misfit import misfit, steps_of

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
    base or points; one of the last joint, to another rotation of a registered tool. Neither does harm.
    """
    instrument = setup.task.rows.kinds & {PositionRows, PoseRows}
    of_base = joint == 0 and (not instrument or "base" in setup.task.registered)
    if of_base or (joint == setup.n - 1 and instrument and "tool" in setup.task.registered):
        return [(sign, angle) for sign, angle in ways if angle == 0.0]
    return ways


def _best(setup: Setup, many: list[JointChanges]) -> list[JointChanges]:
    """Sorted by nominal's rough distance from a few rows; the simplest of equals first."""
    sizes = _sizes(setup, many)
    complexity = np.array([joints.complexity for joints in many])
    return [many[place] for place in np.lexsort((sizes, complexity, steps_of(sizes)))]


def _by_joints(setup: Setup, many: list[JointChanges]) -> list[JointChanges]:
    """The nearest for each set of joints and signs, sorted by distance: the grid is too coarse for more."""
    best: dict[tuple[int, ...], JointChanges] = {}
    for place in np.argsort(_sizes(setup, many), kind="stable"):
        joints = many[place]
        best.setdefault((*joints.sign.astype(int).tolist(), *joints.changed().tolist()), joints)
    return list(best.values())


def _sizes(setup: Setup, many: list[JointChanges]) -> Floats:
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
    free = loose | hypothesis.task.registration(unknowns)
    found = estimate(replace(unknowns, sigma=sigma, prior=None, free=free), blocks)
    for place in np.flatnonzero(loose):
        turn, joint = float(np.rad2deg(found.deviations[place])), unknowns.parameters[place].joint - 1
        joints = joints.with_offset(joint, (joints.offset[joint] + turn + 180.0) % 360.0 - 180.0)
    return joints
