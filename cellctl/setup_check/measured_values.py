"""Measured numbers in another unit, a frame that is left-handed, spheres of another size."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from cellctl.calibration.rows import Measured, PoseRows, PositionRows, TouchRows
from cellctl.kinematics import Floats
from cellctl.setup_check.hypothesis import Change, Hypothesis
from cellctl.setup_check.setup import Setup

UNITS = {"metres": 1000.0, "centimetres": 10.0, "inches": 25.4}


def other_length(setup: Setup) -> Iterator[Hypothesis]:
    """X, Y, Z in another unit."""
    if setup.task.rows.kinds & {PositionRows, PoseRows}:
        for unit, factor in UNITS.items():
            change = Change(f"X, Y, Z are {unit}", "data", "write X, Y, Z in mm", ("X", "Y", "Z"))
            yield Hypothesis((change,), _moved(setup, partial(np.multiply, factor)))


def other_hand(setup: Setup) -> Iterator[Hypothesis]:
    """A left-handed frame. For positions every mirror is as good as any other: the base turns to suit."""
    if PoseRows in setup.task.rows.kinds:
        yield from _mirrored_poses(setup)
    elif PositionRows in setup.task.rows.kinds:
        cure = "reverse one of X, Y, Z, or exchange two of them: the instrument's export says which"
        change = Change("the measuring frame is left-handed", "data", cure, ("X", "Y", "Z"))
        yield Hypothesis((change,), _moved(setup, partial(_turned, np.diag([1.0, -1.0, 1.0]))))


def _mirrored_poses(setup: Setup) -> Iterator[Hypothesis]:
    """Positions alone mirrored, where the orientations tell which axis; or both."""
    for axis, name in enumerate("XYZ"):
        mirror = np.eye(3)
        mirror[axis, axis] = -1.0
        what = f"the measuring frame is left-handed: {name} is reversed"
        change = Change(what, "data", f"reverse the sign of {name}", (name,))
        yield Hypothesis((change,), _moved(setup, partial(_turned, mirror)))
        change = Change("the measuring frame is left-handed, orientations too", "data", "export a right-handed frame")
        yield Hypothesis((change,), setup.with_blocks(partial(_mirrored, mirror)), 1 + axis)
    for first, second in itertools.combinations(range(3), 2):
        exchange = np.eye(3)
        exchange[[first, second]] = exchange[[second, first]]
        names = ("XYZ"[first], "XYZ"[second])
        what = f"the measuring frame is left-handed: {names[0]} and {names[1]} are swapped"
        change = Change(what, "data", f"exchange the names of columns {names[0]} and {names[1]}", names)
        yield Hypothesis((change,), _moved(setup, partial(_turned, exchange)))


def other_spheres(setup: Setup) -> Iterator[Hypothesis]:
    """Spheres whose radius is in another unit, or is their diameter, or half of it."""
    if TouchRows not in setup.task.rows.kinds:
        return
    named = {f"radii are {unit}": factor for unit, factor in UNITS.items()}
    named |= {"diameters stand where radii belong": 0.5, "radii stand where diameters belong": 2.0}
    for what, factor in named.items():
        change = Change(f"spheres: {what}", "artefact", "write radii, or diameters, as asked, in mm", ("radius",))
        yield Hypothesis((change,), setup.with_blocks(partial(_larger, factor)), 1)


def _moved(setup: Setup, change: Callable[[Floats], Floats]) -> Setup:
    """The case with its measured positions changed."""

    def moved(block: Measured) -> Measured:
        if isinstance(block, PositionRows):
            return replace(block, xyz=change(block.xyz))
        if isinstance(block, PoseRows):
            poses = block.poses.copy()
            poses[:, :3, 3] = change(block.xyz)
            return replace(block, poses=poses)
        return block

    return setup.with_blocks(moved)


def _turned(by: Floats, xyz: Floats) -> Floats:
    return np.asarray(xyz @ by.T)


def _mirrored(mirror: Floats, block: Measured) -> Measured:
    if not isinstance(block, PoseRows):
        return block
    poses = block.poses.copy()
    poses[:, :3, 3] = block.xyz @ mirror.T
    poses[:, :3, :3] = mirror @ poses[:, :3, :3] @ mirror
    return replace(block, poses=poses)


def _larger(factor: float, block: Measured) -> Measured:
    return replace(block, reach=factor * block.reach) if isinstance(block, TouchRows) else block
