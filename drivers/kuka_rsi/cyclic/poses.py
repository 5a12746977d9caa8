"""Poses of a chain as plain numbers: the columns x, y, z of the rotation and the place, twelve numbers in a row."""

from __future__ import annotations

import math
from collections.abc import Sequence

Vector = tuple[float, ...]
"""Three numbers."""

Pose = tuple[float, ...]
"""x, y, z and place: twelve numbers; mm."""


def of_matrix(rows: Sequence[float]) -> Pose:
    """From a matrix row by row, four numbers in each of the first three rows."""
    return tuple(rows[4 * row + column] for column in range(4) for row in range(3))


def product(a: Pose, b: Pose) -> Pose:
    """The pose b seen from where a is."""
    x0, x1, x2, y0, y1, y2, z0, z1, z2, p0, p1, p2 = a
    b0, b1, b2, c0, c1, c2, d0, d1, d2, e0, e1, e2 = b
    return (
        x0 * b0 + y0 * b1 + z0 * b2,
        x1 * b0 + y1 * b1 + z1 * b2,
        x2 * b0 + y2 * b1 + z2 * b2,
        x0 * c0 + y0 * c1 + z0 * c2,
        x1 * c0 + y1 * c1 + z1 * c2,
        x2 * c0 + y2 * c1 + z2 * c2,
        x0 * d0 + y0 * d1 + z0 * d2,
        x1 * d0 + y1 * d1 + z1 * d2,
        x2 * d0 + y2 * d1 + z2 * d2,
        x0 * e0 + y0 * e1 + z0 * e2 + p0,
        x1 * e0 + y1 * e1 + z1 * e2 + p1,
        x2 * e0 + y2 * e1 + z2 * e2 + p2,
    )


def inverted(a: Pose) -> Pose:
    """The inverse."""
    x, y, z, p = a[:3], a[3:6], a[6:9], a[9:]
    return (x[0], y[0], z[0], x[1], y[1], z[1], x[2], y[2], z[2], -dot(x, p), -dot(y, p), -dot(z, p))


def frames_of(constants: Sequence[Pose], q: Sequence[float]) -> list[Pose]:
    """The frames behind the joints and the end, of C0 Rz(q1) C1 … Rz(qn) Cn at angles q, rad."""
    found: list[Pose] = []
    here = constants[0]
    for angle, after in zip(q, constants[1:], strict=True):
        cosine, sine = math.cos(angle), math.sin(angle)
        x0, x1, x2, y0, y1, y2, *others = here
        here = (
            cosine * x0 + sine * y0,
            cosine * x1 + sine * y1,
            cosine * x2 + sine * y2,
            cosine * y0 - sine * x0,
            cosine * y1 - sine * x1,
            cosine * y2 - sine * x2,
            *others,
        )
        found.append(here)
        here = product(here, after)
    return [*found, here]


def times(a: Pose, vector: Vector) -> Vector:
    """A vector turned by the rotation of a pose."""
    u, v, w = vector
    return (a[0] * u + a[3] * v + a[6] * w, a[1] * u + a[4] * v + a[7] * w, a[2] * u + a[5] * v + a[8] * w)


def plus(a: Vector, b: Vector) -> Vector:
    """a + b."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


def dot(a: Vector, b: Vector) -> float:
    """a · b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Vector, b: Vector) -> Vector:
    """a × b."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])
