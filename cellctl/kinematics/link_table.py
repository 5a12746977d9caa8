"""Robots given by a table with a row for each link: modified Denavit–Hartenberg with Hayati's β, and Craig's form."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias, final, get_args

import numpy as np

from cellctl.kinematics.elementary import Motion, Segment

TableConvention: TypeAlias = Literal["mdh-hayati", "dh-craig"]
"""How a row of a link table becomes a transform: see `Link`."""

TABLE_CONVENTIONS: tuple[str, ...] = get_args(TableConvention)


@final
@dataclass(frozen=True, slots=True)
class Link:
    """One row of a link table; angles in rad, lengths in mm.

    mdh-hayati: T = Rz(joint + theta) Tz(d) Tx(a) Rx(alpha) Ry(beta), the joint first.
    dh-craig: T = Rx(alpha) Tx(a) Ry(beta) Rz(joint + theta) Tz(d), the joint last.
    Where `beta` is given (axes near parallel), `d` is a constant and not a parameter: the two are not separable.
    """

    theta: float = 0.0
    d: float = 0.0
    a: float = 0.0
    alpha: float = 0.0
    beta: float | None = None


@final
@dataclass(frozen=True)
class LinkTable:
    """The rows of a link table, and how to read them. Parameters: theta1, d1, a1, alpha1, beta1, …."""

    convention: TableConvention
    links: tuple[Link, ...]

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.links)

    def segments(self) -> list[Segment]:
        """The parts between the joints: n + 1 segments, the first before joint 1, the last from joint n to the flange.

        From the second on, a segment begins in the frame behind its joint.
        """
        segments: list[list[Motion]] = [[] for _ in range(self.n + 1)]
        for index, link in enumerate(self.links):
            theta, d, a, alpha, *beta = _motions(link, index + 1)
            if self.convention == "mdh-hayati":
                segments[index + 1] += [theta, d, a, alpha, *beta]
            else:
                segments[index] += [alpha, a, *beta]
                segments[index + 1] += [theta, d]
        return [(np.eye(4), motions) for motions in segments]


def _motions(link: Link, number: int) -> list[Motion]:
    parallel = link.beta is not None
    return [
        Motion(f"theta{number}", True, 2, link.theta),
        Motion(None if parallel else f"d{number}", False, 2, link.d),
        Motion(f"a{number}", False, 0, link.a),
        Motion(f"alpha{number}", True, 0, link.alpha),
        *([] if link.beta is None else [Motion(f"beta{number}", True, 1, link.beta)]),
    ]
