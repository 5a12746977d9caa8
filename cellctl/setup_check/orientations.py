"""Measured orientations in another form than the data set's Rz(A) Ry(B) Rx(C), degrees."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from cellctl.calibration.rows import Measured, PoseRows
from cellctl.kinematics import Floats, abc_from_rotation
from cellctl.setup_check.hypothesis import Change, Hypothesis, Setup
from cellctl.setup_check.units_and_conventions import RADIANS_UP_TO

ABC = ("A", "B", "C")
CONVERT = "convert to Rz(A) Ry(B) Rx(C), or give QW, QX, QY, QZ"
SEQUENCES = [f"{a}{b}{c}" for a, b, c in itertools.product("XYZ", repeat=3) if a != b != c]


def other_orientations(setup: Setup) -> Iterator[Hypothesis]:
    """Other Euler angles, rotation vectors, radians; inverse rotations.

    The angles are computed from the rotations that were read, so that |B| ≤ 90°.
    """
    blocks = [block for block in setup.task.rows.blocks if isinstance(block, PoseRows)]
    if not blocks:
        return
    yield _hypothesis(setup, "orientations are inverse: from tool to frame", "invert each", 2, Rotation.inv)
    largest = max(np.abs(abc_from_rotation(block.poses[:, :3, :3])).max(initial=0.0) for block in blocks)
    for unit, factor in (("", 1.0), (" in radians", 180.0 / np.pi))[: 1 + (largest < RADIANS_UP_TO)]:
        yield from _euler_angles(setup, unit, factor)

        def of_vector(read: Rotation, factor: float = factor) -> Rotation:
            return Rotation.from_rotvec(factor * _abc(read), degrees=True)

        yield _hypothesis(setup, f"A, B, C are a rotation vector{unit}", CONVERT, 1, of_vector)


def _euler_angles(setup: Setup, unit: str, factor: float) -> Iterator[Hypothesis]:
    for sequence in (form for letters in SEQUENCES for form in (letters, letters.lower())):

        def of_angles(read: Rotation, sequence: str = sequence) -> Rotation:
            return Rotation.from_euler(sequence, factor * _abc(read), degrees=True)

        if sequence != "ZYX":
            axes = "turned" if sequence.isupper() else "fixed"
            what = f"A, B, C are {sequence.upper()} angles{unit}, about the {axes} axes"
            complexity = 0 if sequence.upper() == "XYZ" else 1 if len(set(sequence)) == 3 else 2
            yield _hypothesis(setup, what, CONVERT, complexity, of_angles)
        elif unit:
            yield _hypothesis(setup, "A, B, C are radians", "write degrees", 0, of_angles)


def _abc(rotation: Rotation) -> Floats:
    return abc_from_rotation(rotation.as_matrix())


def _hypothesis(
    setup: Setup, what: str, cure: str, complexity: int, change: Callable[[Rotation], Rotation]
) -> Hypothesis:
    def turned(block: Measured) -> Measured:
        if not isinstance(block, PoseRows):
            return block
        poses = block.poses.copy()
        poses[:, :3, :3] = change(Rotation.from_matrix(poses[:, :3, :3])).as_matrix()
        return replace(block, poses=poses)

    return Hypothesis((Change(what, "data", cure, ABC),), setup.with_blocks(turned), complexity)
