"""A chain as a row of elementary motions: a turn about, or a slide along, one axis of the frame reached so far.

Every geometric parameter is the value of one such motion: its derivative is a unit screw, fixed in that frame.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple, TypeAlias

import numpy as np

from cellctl.kinematics.arrays import Floats


class Motion(NamedTuple):
    """A turn (rad) or slide (mm) by `value` about or along axis 0, 1 or 2 (x, y, z); `name` where it is a parameter."""

    name: str | None
    turns: bool
    axis: int
    value: float


Segment: TypeAlias = tuple[Floats, list[Motion]]
"""The part between two joints: a fixed pose (4, 4), then motions."""


_IDENTITY = np.eye(4)


def motion_matrix(motion: Motion) -> Floats:
    """The 4×4 transform of one elementary motion."""
    result = _IDENTITY.copy()
    if not motion.turns:
        result[motion.axis, 3] = motion.value
        return result
    i, j = (motion.axis + 1) % 3, (motion.axis + 2) % 3
    cosine, sine = math.cos(motion.value), math.sin(motion.value)
    result[i, i] = result[j, j] = cosine
    result[i, j], result[j, i] = -sine, sine
    return result


def segment_matrix(segment: Segment) -> Floats:
    """The 4×4 transform of a whole segment."""
    matrix, motions = segment
    for motion in motions:
        if motion.value:
            matrix = matrix @ motion_matrix(motion)
    return matrix


def frame_motions(frame: str) -> Iterator[Motion]:
    """The six small motions, all zero, by which frame `base` or `tool` may differ from its stated pose."""
    for axis, letter in enumerate("xyz"):
        yield Motion(f"{frame}_{letter}", False, axis, 0.0)
    for axis, letter in ((2, "a"), (1, "b"), (0, "c")):
        yield Motion(f"{frame}_{letter}", True, axis, 0.0)
