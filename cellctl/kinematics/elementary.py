"""A chain as a row of elementary motions: a turn about, or a slide along, one axis of the frame reached so far.

Every geometric parameter is the value of one such motion: its derivative is a unit screw, fixed in that frame.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple, TypeAlias, final, get_args

import numpy as np

from cellctl.kinematics.arrays import Floats

Convention: TypeAlias = Literal["mdh-hayati", "dh-craig"]
"""How a row of a link table becomes a transform: see `Link`."""

CONVENTIONS: tuple[str, ...] = get_args(Convention)


@final
@dataclass(frozen=True, slots=True)
class Link:
    """One row of a link table; angles in rad, lengths in mm.

    mdh-hayati: T = Rz(joint + theta) Tz(d) Tx(a) Rx(alpha) Ry(beta), the joint first.
    dh-craig: T = Rx(alpha) Tx(a) Ry(beta) Rz(joint + theta) Tz(d), the joint last.
    Where `beta` is given (axes near parallel), `d` is a constant and not a parameter: the two cannot be told apart.
    """

    theta: float = 0.0
    d: float = 0.0
    a: float = 0.0
    alpha: float = 0.0
    beta: float | None = None


class Motion(NamedTuple):
    """A turn (rad) or slide (mm) by `value` about or along axis 0, 1 or 2 (x, y, z); `name` where it is a parameter."""

    name: str | None
    turns: bool
    axis: int
    value: float


def motion_matrix(motion: Motion) -> Floats:
    """The 4×4 transform of one elementary motion."""
    result = np.eye(4)
    if not motion.turns:
        result[motion.axis, 3] = motion.value
        return result
    i, j = (motion.axis + 1) % 3, (motion.axis + 2) % 3
    cosine, sine = np.cos(motion.value), np.sin(motion.value)
    result[i, i] = result[j, j] = cosine
    result[i, j], result[j, i] = -sine, sine
    return result


def frame_motions(frame: str) -> Iterator[Motion]:
    """The six small motions, all zero, by which frame `base` or `tool` may differ from where it was said to be."""
    for axis, letter in enumerate("xyz"):
        yield Motion(f"{frame}_{letter}", False, axis, 0.0)
    for axis, letter in ((2, "a"), (1, "b"), (0, "c")):
        yield Motion(f"{frame}_{letter}", True, axis, 0.0)


def link_motions(convention: Convention, links: Sequence[Link]) -> list[list[Motion]]:
    """The motions between the joints: n + 1 lists, the first before joint 1, the last from joint n to the flange."""
    segments: list[list[Motion]] = [[] for _ in range(len(links) + 1)]
    for index, link in enumerate(links):
        number = index + 1
        theta = Motion(f"theta{number}", True, 2, link.theta)
        d = Motion(None if link.beta is not None else f"d{number}", False, 2, link.d)
        a = Motion(f"a{number}", False, 0, link.a)
        alpha = Motion(f"alpha{number}", True, 0, link.alpha)
        beta = [] if link.beta is None else [Motion(f"beta{number}", True, 1, link.beta)]
        if convention == "mdh-hayati":
            segments[number] += [theta, d, a, alpha, *beta]
        else:
            segments[index] += [alpha, a, *beta]
            segments[number] += [theta, d]
    return segments
