"""Measured orientations written in another way than the data set's Rz(A) Ry(B) Rx(C), degrees."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from cellctl.calibration.rows import Measured, PoseRows
from cellctl.kinematics import Floats, abc_from_rotation
from cellctl.setup_check.case import Case
from cellctl.setup_check.supposition import Change, Supposition

ABC = ("A", "B", "C")
RADIANS_UP_TO = 2.1 * np.pi
SEQUENCES = [f"{a}{b}{c}" for a, b, c in itertools.product("XYZ", repeat=3) if a != b != c]


def other_turns(case: Case) -> Iterator[Supposition]:
    """Other Euler angles, rotation vectors, radians; rotations the other way round.

    The angles are worked out from the rotations that were read: |B| ≤ 90° is then taken for granted.
    """
    if PoseRows not in case.task.rows.kinds:
        return
    yield _supposed(case, "orientations are inverse: from tool to frame", "invert each", 2, lambda turn: turn.inv())
    small = all(
        np.abs(abc_from_rotation(block.poses[:, :3, :3])).max(initial=0.0) < RADIANS_UP_TO
        for block in case.task.rows.blocks
        if isinstance(block, PoseRows)
    )
    for unit, factor in (("", 1.0), (" in radians", 180.0 / np.pi)) if small else (("", 1.0),):
        yield from _euler(case, unit, factor)
        what, cure = f"A, B, C are a rotation vector{unit}", "convert to Rz(A) Ry(B) Rx(C), or give QW, QX, QY, QZ"
        yield _supposed(
            case, what, cure, 1, lambda turn, by=factor: Rotation.from_rotvec(by * _abc(turn), degrees=True)
        )


def _euler(case: Case, unit: str, factor: float) -> Iterator[Supposition]:
    for letters in SEQUENCES:
        for sequence in (letters, letters.lower()):
            if sequence == "ZYX" and not unit:
                continue
            said = "about the turned axes" if sequence.isupper() else "about the fixed axes"
            what = "A, B, C are radians" if sequence == "ZYX" else f"A, B, C are {letters} angles{unit}, {said}"
            what = "A, B, C are radians" if sequence == "ZYX" else what
            cure = "write degrees" if sequence == "ZYX" else "convert to Rz(A) Ry(B) Rx(C), or give QW, QX, QY, QZ"
            odd = 0 if sequence in ("ZYX", "XYZ", "xyz") else 1 if len(set(letters)) == 3 else 2
            yield _supposed(
                case,
                what,
                cure,
                odd,
                lambda turn, by=factor, order=sequence: Rotation.from_euler(order, by * _abc(turn), degrees=True),
            )


def _abc(turn: Rotation) -> Floats:
    return abc_from_rotation(turn.as_matrix())


def _supposed(case: Case, what: str, cure: str, oddity: int, change: object) -> Supposition:
    def turned(block: Measured) -> Measured:
        if not isinstance(block, PoseRows):
            return block
        poses = block.poses.copy()
        poses[:, :3, :3] = change(Rotation.from_matrix(poses[:, :3, :3])).as_matrix()  # type: ignore[operator]
        return replace(block, poses=poses)

    return Supposition((Change(what, "data", cure, ABC),), case.with_blocks(turned), oddity)
