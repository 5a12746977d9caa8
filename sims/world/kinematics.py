"""Kinematics of the simulated robot: product of screws, the robot file's geometry, the true arm, the shown pose.

A frame at model zero is carried by `p(θ) = e^{ξ1 θ1} … e^{ξn θn} p(0)`, each factor a turn about an axis fixed in the
base frame. Unrolled over x, y, z because this runs in every interpolation cycle: numpy would cost ten times as much.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import asin, atan2, cos, degrees, radians, sin
from typing import final

import numpy as np
from numpy.typing import NDArray

from sims.robot_file import CRAIG, POE, Link, RobotFile, Screw

Vector = tuple[float, float, float]
"""x, y, z in the robot's base frame; mm for points, without unit for directions."""


@final
@dataclass(frozen=True, slots=True)
class Axis:
    """A revolute joint's axis at model zero: a point on it (mm, base frame) and its unit direction."""

    point: Vector
    direction: Vector


@final
class Arm:
    """A serial chain of revolute axes, base first."""

    __slots__ = ("_outward_in", "axes")

    def __init__(self, axes: Sequence[Axis]) -> None:
        self.axes = tuple(axes)
        self._outward_in = [axis.direction + axis.point for axis in reversed(self.axes)]

    def carry(self, angles: Sequence[float], point: Vector, *directions: Vector) -> tuple[Vector, ...]:
        """Where `point` (mm) and `directions`, given at model zero, are at model `angles` (rad); the point first."""
        x, y, z = point
        turned = list(directions)
        for (wx, wy, wz, px, py, pz), angle in zip(self._outward_in, reversed(angles), strict=True):
            c = cos(angle)
            s = sin(angle)
            x -= px
            y -= py
            z -= pz
            along = (1.0 - c) * (wx * x + wy * y + wz * z)
            x, y, z = (
                px + c * x + s * (wy * z - wz * y) + along * wx,
                py + c * y + s * (wz * x - wx * z) + along * wy,
                pz + c * z + s * (wx * y - wy * x) + along * wz,
            )
            for i, (u, v, w) in enumerate(turned):
                along = (1.0 - c) * (wx * u + wy * v + wz * w)
                turned[i] = (
                    c * u + s * (wy * w - wz * v) + along * wx,
                    c * v + s * (wz * u - wx * w) + along * wy,
                    c * w + s * (wx * v - wy * u) + along * wz,
                )
        return (x, y, z), *turned


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


@final
@dataclass(frozen=True, slots=True)
class Chain:
    """An arm and what it carries, at model zero in the base frame.

    `flange`, `tcp`: points, mm; `offset`: from one to the other; `flange_x`, `flange_z`, `tool_x`, `tool_z`:
    directions.
    """

    arm: Arm
    flange: Vector
    offset: Vector
    tcp: Vector
    flange_x: Vector
    flange_z: Vector
    tool_x: Vector
    tool_z: Vector


def chain_of(geometry: Geometry, tool: Matrix) -> Chain:
    """`tool`: 4×4, flange ← tool, mm."""
    turned, place = geometry.flange[:3, :3], geometry.flange[:3, 3]
    offset, directions = turned @ tool[:3, 3], turned @ tool[:3, :3]
    return Chain(
        arm=Arm(geometry.axes),
        flange=vector(place),
        offset=vector(offset),
        tcp=vector(offset + place),
        flange_x=vector(geometry.flange[:3, 0]),
        flange_z=vector(geometry.flange[:3, 2]),
        tool_x=vector(directions[:, 0]),
        tool_z=vector(directions[:, 2]),
    )


Pose = tuple[float, float, float, float, float, float]
"""X Y Z (mm) and A B C (degrees, KUKA)."""


@final
class Shown:
    """Of one robot file. `arm`: the nominal one; `tcp`: the taught TCP at model zero, mm, base frame."""

    def __init__(self, robot: RobotFile, nominal: Geometry) -> None:
        tool = nominal.flange @ pose(robot.tool.xyz, robot.tool.abc)
        self.arm = Arm(nominal.axes)
        self.tcp = vector(tool[:3, 3])
        self._directions = vector(tool[:3, 0]), vector(tool[:3, 2])
        self._joints = [(float(joint.sign), float(joint.offset)) for joint in robot.joints]

    def pose(self, readings: Sequence[float]) -> Pose:
        """X Y Z A B C at these readings."""
        angles = [
            radians(sign * reading + offset) for (sign, offset), reading in zip(self._joints, readings, strict=True)
        ]
        place, along_x, along_z = self.arm.carry(angles, self.tcp, *self._directions)
        return *place, *angles_abc(along_x, along_z)


def angles_abc(x: Vector, z: Vector) -> Vector:
    """A, B, C in degrees of a frame with these directions."""
    xx, xy, xz = x
    zx, zy, zz = z
    return (
        degrees(atan2(xy, xx)),
        degrees(asin(max(-1.0, min(1.0, -xz)))),
        degrees(atan2(zx * xy - zy * xx, zz)),  # z of y = z × x
    )
