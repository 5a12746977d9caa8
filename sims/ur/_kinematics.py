"""What the controller knows of its arm: Denavit-Hartenberg rows with its own calibration, and their kinematics.

Row i: Rz(θ + q) Tz(d) Tx(a) Rx(α), after the maker's "DH parameters for calculations of kinematics and dynamics".
Metres and radians. The controller's base is the frame of the first row: z along joint 1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import atan2, cos, hypot, radians, sin
from typing import final

import numpy as np

from sims.robot_file import HAYATI, RobotFile
from sims.ur._poses import NO_TOOL, Matrix, Pose, matrix_of, pose_of, vector_of
from sims.world.errors import joint_zero_errors, true_geometry
from sims.world.kinematics import Axis, Geometry, nominal_geometry

AXES = 6
ITERATIONS = 50
"""Most Newton steps of an inverse kinematics."""
POSITION_M, ORIENTATION_RAD = 1e-10, 1e-10
"""An inverse kinematics is asked for no more than this by default."""
LARGEST_STEP_RAD = 0.5
DAMPING = 1e-3
"""Of a Newton step, times the squared error: nothing near the solution."""

Joints = tuple[float, ...]


class NotThisArm(ValueError):
    """The robot file is not of an arm that this controller drives; the text gives the reason."""


@final
@dataclass(frozen=True, slots=True)
class Row:
    """One joint's row."""

    theta: float
    a: float
    d: float
    alpha: float


def nominal_rows(robot: RobotFile) -> tuple[Row, ...]:
    """Of the robot file. Raises NotThisArm."""
    plain = robot.convention == HAYATI and not any(link.beta for link in robot.links)
    if len(robot.joints) != AXES or not plain:
        raise NotThisArm(f"this controller drives six joints after Denavit-Hartenberg, not those of '{robot.name}'")
    if any(joint.sign != 1 for joint in robot.joints):
        raise NotThisArm(f"the joints of '{robot.name}' count against their axes, which those of a UR do not")
    return tuple(
        Row(radians(link.theta + joint.offset), link.a * 1e-3, link.d * 1e-3, radians(link.alpha))
        for link, joint in zip(robot.links, robot.joints, strict=True)
    )


def calibrated_rows(robot: RobotFile, seed: int, errors: dict[str, float], known: float) -> tuple[Row, ...]:
    """Those of the controller whose calibration knows this share of the true arm's errors. Raises NotThisArm.

    The last row keeps its length and twist, so that the flange's tilt and shift against joint 6 stay unknown.
    """
    nominal = nominal_rows(robot)
    if not known:
        return nominal
    geometry = true_geometry(nominal_geometry(robot), seed, known * errors["geometry"])
    zeros = joint_zero_errors(AXES, seed, known * errors["joint_zero"])
    rows = rows_of(geometry, nominal)
    offsets = [radians(joint.offset + zero) for joint, zero in zip(robot.joints, zeros, strict=True)]
    return tuple(replace(row, theta=row.theta + offset) for row, offset in zip(rows, offsets, strict=True))


def rows_of(geometry: Geometry, nominal: Sequence[Row]) -> tuple[Row, ...]:
    """The rows of these axes at model zero (mm, any base), their frames nearest to the nominal ones.

    x of each frame is the common normal of an axis and the next. Axes that are almost parallel meet it far away: d of
    both rows is then large, as in the calibration of a real UR.
    """
    axes = geometry.axes
    direction = _direction(axes[0])
    origin = _foot(axes[0], np.zeros(3))
    x = _across(direction, np.array([1.0, 0.0, 0.0]))
    # the nominal frames tell which of its two directions a normal has, however far the axes turn it
    frames = Model(nominal).frames((0.0,) * AXES)
    rows = []
    for axis, following, frame in zip(axes, axes[1:], frames[1:], strict=False):
        z, onward = _direction(axis), _direction(following)
        normal, here, there = _common_normal(axis, following, np.array(frame[0]))
        rows.append(
            Row(
                _angle(x, normal, z),
                float((there - here) @ normal) * 1e-3,
                float((here - origin) @ z) * 1e-3,
                _angle(z, onward, normal),
            )
        )
        x, origin = normal, there
    z = _direction(axes[-1])
    flange_x = _across(z, geometry.flange[:3, 0])
    last = nominal[-1]
    along = float((geometry.flange[:3, 3] - origin) @ z) * 1e-3
    return *rows, Row(_angle(x, flange_x, z), last.a, along, last.alpha)


def _common_normal(axis: Axis, following: Axis, wanted: Matrix) -> tuple[Matrix, Matrix, Matrix]:
    """Its direction, the one of two that is nearer to the wanted one, and its feet on both axes."""
    z, onward = _direction(axis), _direction(following)
    p, q = np.array(axis.point), np.array(following.point)
    cross = np.cross(z, onward)
    sine = float(np.linalg.norm(cross))
    if sine < 1e-12:  # parallel: any normal does, and the nominal place is taken
        foot = _foot(axis, p)
        there = _foot(following, foot)
        gap = there - foot
        normal = gap / np.linalg.norm(gap) if np.linalg.norm(gap) else _across(z, wanted)
        return (normal if normal @ wanted > 0 else -normal), foot, there
    normal = cross / sine
    if normal @ wanted < 0:
        normal = -normal
    # p + s z + (common normal) = q + t onward
    s, t, _ = np.linalg.solve(np.column_stack([z, -onward, cross]), q - p)
    return normal, p + s * z, q + t * onward


def _direction(axis: Axis) -> Matrix:
    return np.array(axis.direction)


def _foot(axis: Axis, point: Matrix) -> Matrix:
    """The point of the axis that is nearest."""
    z, p = _direction(axis), np.array(axis.point)
    return np.asarray(p + ((point - p) @ z) * z)


def _across(z: Matrix, x: Matrix) -> Matrix:
    """The direction across z that is nearest to x."""
    out = x - (x @ z) * z
    return np.asarray(out / np.linalg.norm(out))


def _angle(start: Matrix, end: Matrix, about: Matrix) -> float:
    return atan2(float(np.cross(start, end) @ about), float(start @ end))


Frame = tuple[tuple[float, float, float], ...]
"""Directions x, y, z and origin, in the base."""


@final
class Model:
    """Forward and inverse kinematics of such rows. Joints in rad, poses in the controller's base, m.

    Unrolled over x, y, z, as it runs several times in each of the controller's cycles.
    """

    def __init__(self, rows: Sequence[Row]) -> None:
        self.rows = tuple(rows)
        self._rows = [(row.theta, row.a, row.d, cos(row.alpha), sin(row.alpha)) for row in rows]
        self._cached: tuple[Joints, list[Frame]] = ((), [])

    def flange(self, joints: Joints) -> Matrix:
        """4×4, base ← flange."""
        out = np.eye(4)
        out[:3] = np.array(self.frames(joints)[-1]).T
        return out

    def tcp(self, joints: Joints, tool: Matrix) -> Pose:
        """The TCP's pose. `tool`: 4×4, flange ← TCP."""
        return pose_of(self.flange(joints) @ tool)

    def jacobian(self, joints: Joints, tool: Matrix) -> Matrix:
        """6×6: the TCP's velocity and angular velocity in the base, by joint velocities."""
        frames = self.frames(joints)
        tx, ty, tz = (self.flange(joints) @ tool[:, 3])[:3].tolist()
        columns = []
        for _, _, (zx, zy, zz), (px, py, pz) in frames[:-1]:
            rx, ry, rz = tx - px, ty - py, tz - pz
            columns.append((zy * rz - zz * ry, zz * rx - zx * rz, zx * ry - zy * rx, zx, zy, zz))
        return np.array(columns).T

    def velocity(self, joints: Joints, tool: Matrix, speeds: Sequence[float]) -> Pose:
        """The TCP's velocity and angular velocity."""
        if not any(speeds):
            return NO_TOOL
        x, y, z, a, b, c = (self.jacobian(joints, tool) @ np.array(speeds)).tolist()
        return x, y, z, a, b, c

    def joints_at(
        self,
        pose: Sequence[float],
        near: Joints,
        tool: Matrix,
        position_m: float = POSITION_M,
        orientation_rad: float = ORIENTATION_RAD,
    ) -> Joints | None:
        """The joints nearest to `near`, by Newton's method from there; None where it finds none."""
        wanted, found = matrix_of(pose), near
        for _ in range(ITERATIONS):
            now = self.flange(found) @ tool
            move = (wanted[:3, 3] - now[:3, 3]).tolist()
            turn = vector_of(wanted[:3, :3] @ now[:3, :3].T)
            if hypot(*move) <= position_m and hypot(*turn) <= orientation_rad:
                return found
            # damped where the arm is singular or far away: a step is never longer than LARGEST_STEP_RAD
            jacobian, error = self.jacobian(found, tool), np.array([*move, *turn])
            damping = DAMPING * float(error @ error) + 1e-12
            step = np.linalg.solve(jacobian.T @ jacobian + damping * np.eye(AXES), jacobian.T @ error).tolist()
            share = min(1.0, LARGEST_STEP_RAD / max(1e-12, *map(abs, step)))
            found = tuple(joint + share * part for joint, part in zip(found, step, strict=True))
        return None

    def speeds_for(self, joints: Joints, tool: Matrix, velocity: Sequence[float]) -> Joints | None:
        """Joint velocities for one of the TCP; None in a singularity."""
        try:
            return tuple(np.linalg.solve(self.jacobian(joints, tool), np.array(velocity, dtype=float)).tolist())
        except np.linalg.LinAlgError:
            return None

    def frames(self, joints: Joints) -> list[Frame]:
        """The base, and the frame after each row."""
        if self._cached[0] == joints:
            return self._cached[1]
        x, y, z, p = _BASE
        frames = [_BASE]
        for (theta, a, d, cosine, sine), joint in zip(self._rows, joints, strict=True):
            c, s = cos(theta + joint), sin(theta + joint)
            (xx, xy, xz), (yx, yy, yz), (zx, zy, zz), (px, py, pz) = x, y, z, p
            ux, uy, uz = c * yx - s * xx, c * yy - s * xy, c * yz - s * xz  # y once turned about z
            x = (c * xx + s * yx, c * xy + s * yy, c * xz + s * yz)
            y = (cosine * ux + sine * zx, cosine * uy + sine * zy, cosine * uz + sine * zz)
            p = (px + d * zx + a * x[0], py + d * zy + a * x[1], pz + d * zz + a * x[2])
            z = (cosine * zx - sine * ux, cosine * zy - sine * uy, cosine * zz - sine * uz)
            frames.append((x, y, z, p))
        self._cached = (joints, frames)
        return frames


_BASE: Frame = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, 0.0))
