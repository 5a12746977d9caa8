"""The robot from its file: joint axes and home pose of the flange, from the link table or as they stand there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from sims.robot_file import CRAIG, POE, Link, RobotFile, Screw
from sims.world.screws import Axis, Vector

Matrix = NDArray[np.float64]


@final
@dataclass(frozen=True, slots=True)
class Geometry:
    """Axes and flange of a robot at model zero. `flange`: 4×4, base ← flange, mm."""

    axes: tuple[Axis, ...]
    flange: Matrix


def nominal_geometry(robot: RobotFile) -> Geometry:
    """Axis i is where the table's row i turns about z, at model zero; the flange is the last frame."""
    frame = pose(robot.base.xyz, robot.base.abc)
    if robot.convention == POE:
        return Geometry(
            tuple(_placed(frame, screw) for screw in robot.screws), frame @ pose(robot.home.xyz, robot.home.abc)
        )
    axes = []
    for link in robot.links:
        about_z, about_x = link_transforms(link)
        if robot.convention == CRAIG:
            frame = frame @ about_x
        axes.append(Axis(point=vector(frame[:3, 3]), direction=vector(frame[:3, 2])))
        frame = frame @ about_z
        if robot.convention != CRAIG:
            frame = frame @ about_x
    return Geometry(tuple(axes), frame)


def _placed(base: Matrix, screw: Screw) -> Axis:
    """The axis that stands so in a base, 4×4, in the frame that this is given in."""
    direction = base[:3, :3] @ np.array(screw.axis)
    return Axis(
        point=vector(base[:3, :3] @ np.array(screw.point) + base[:3, 3]),
        direction=vector(direction / np.linalg.norm(direction)),
    )


def link_transforms(link: Link) -> tuple[Matrix, Matrix]:
    """One row of the table: Rz(θ) Tz(d), and what stands behind it (before it, after Craig): Tx(a) Rx(α) Ry(β), whose
    first two change places freely. 4×4, mm; the row's angles in degrees.
    """
    about_z, about_x = np.eye(4), np.eye(4)
    about_z[:3, :3] = turn([0.0, 0.0, link.theta])
    about_z[2, 3] = link.d
    about_x[:3, :3] = turn([link.alpha, 0.0, 0.0]) @ turn([0.0, link.beta, 0.0])
    about_x[0, 3] = link.a
    return about_z, about_x


def pose(xyz: Sequence[float], abc: Sequence[float]) -> Matrix:
    """4×4 of a place (mm) and KUKA angles A, B, C (degrees): Rz(A) Ry(B) Rx(C)."""
    a, b, c = abc
    out = np.eye(4)
    out[:3, :3] = turn([0.0, 0.0, a]) @ turn([0.0, b, 0.0]) @ turn([c, 0.0, 0.0])
    out[:3, 3] = xyz
    return out


def turn(rotation_vector_deg: Sequence[float] | Matrix) -> Matrix:
    """3×3 rotation about the vector's direction by its length in degrees (Rodrigues)."""
    vector_rad = np.radians(rotation_vector_deg)
    angle = float(np.linalg.norm(vector_rad))
    if angle == 0.0:
        return np.eye(3)
    x, y, z = vector_rad / angle
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross, dtype=float)


def vector(values: Sequence[float] | Matrix) -> Vector:
    """Three numbers as plain floats, which the cyclic code is fastest with."""
    x, y, z = (float(value) for value in values)
    return x, y, z
