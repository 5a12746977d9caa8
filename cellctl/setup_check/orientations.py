"""Measured orientations written in another way than the data set's Rz(A) Ry(B) Rx(C), degrees."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from cellctl.calibration.rows import Measured, PoseRows
from cellctl.kinematics import Floats, abc_from_rotation
from cellctl.setup_check.hypothesis import Change, Hypothesis
from cellctl.setup_check.setup import Setup

ABC = ("A", "B", "C")
RADIANS_UP_TO = 2.1 * np.pi
SEQUENCES = [f"{a}{b}{c}" for a, b, c in itertools.product("XYZ", repeat=3) if a != b != c]


def other_orientations(setup: Setup) -> Iterator[Hypothesis]:
    """Other Euler angles, rotation vectors, radians; rotations the other way round.

    The angles are worked out from the rotations that were read: |B| ≤ 90° is then taken for granted.
    """
    if PoseRows not in setup.task.rows.kinds:
        return
    yield _hypothesis(setup, "orientations are inverse: from tool to frame", "invert each", 2, lambda turn: turn.inv())
    small = all(
        np.abs(abc_from_rotation(block.poses[:, :3, :3])).max(initial=0.0) < RADIANS_UP_TO
        for block in setup.task.rows.blocks
        if isinstance(block, PoseRows)
    )
    for unit, factor in (("", 1.0), (" in radians", 180.0 / np.pi)) if small else (("", 1.0),):
        yield from _euler(setup, unit, factor)
        what, cure = f"A, B, C are a rotation vector{unit}", "convert to Rz(A) Ry(B) Rx(C), or give QW, QX, QY, QZ"
        yield _hypothesis(
            setup, what, cure, 1, lambda turn, by=factor: Rotation.from_rotvec(by * _abc(turn), degrees=True)
        )


def _euler(setup: Setup, unit: str, factor: float) -> Iterator[Hypothesis]:
    for letters in SEQUENCES:
        for sequence in (letters, letters.lower()):
            if sequence == "ZYX" and not unit:
                continue
            said = "about the turned axes" if sequence.isupper() else "about the fixed axes"
            what = "A, B, C are radians" if sequence == "ZYX" else f"A, B, C are {letters} angles{unit}, {said}"
            what = "A, B, C are radians" if sequence == "ZYX" else what
            cure = "write degrees" if sequence == "ZYX" else "convert to Rz(A) Ry(B) Rx(C), or give QW, QX, QY, QZ"
            complexity = 0 if sequence in ("ZYX", "XYZ", "xyz") else 1 if len(set(letters)) == 3 else 2
            yield _hypothesis(
                setup,
                what,
                cure,
                complexity,
                lambda turn, by=factor, order=sequence: Rotation.from_euler(order, by * _abc(turn), degrees=True),
            )


def _abc(turn: Rotation) -> Floats:
    return abc_from_rotation(turn.as_matrix())


def _hypothesis(setup: Setup, what: str, cure: str, complexity: int, change: object) -> Hypothesis:
    def turned(block: Measured) -> Measured:
        if not isinstance(block, PoseRows):
            return block
        poses = block.poses.copy()
        poses[:, :3, :3] = change(Rotation.from_matrix(poses[:, :3, :3])).as_matrix()  # type: ignore[operator]
        return replace(block, poses=poses)

    return Hypothesis((Change(what, "data", cure, ABC),), setup.with_blocks(turned), complexity)
