"""Measured reflectors: recorded points as arrays, the plate on the flange, and columns of a data set.

The covariance of a row: of its points for themselves, and the robot's repeatability. The part that all points share
(range zero and scale, refraction, centring) is none of a row's own: more rows do not reduce it.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import final

import numpy as np
from scipy.spatial.transform import Rotation

from cellctl.devices import DeviceError, MeasuredPoint
from cellctl.formats import reflectors_of
from cellctl.kinematics import Floats
from cellctl.metrology import NestPlate, NestsDoNotFit, Points, check_nests, plate_pose
from cellctl.procedure import StepContext
from cellctl.records import Rows
from procedures.steps.tracker.rows import PoseRow

_ROUGH_MM = 2.0
"""1 σ of a reflector's place in the cell file, on each axis."""

_FIRST_POSES = 5
"""Poses whose plate checks the others."""


@final
class NestsDisagree(DeviceError):
    """The nests moved against each other: one is loose, badly seated, or the station moved in the visit."""


def points_of(measured: Sequence[MeasuredPoint]) -> Points:
    """Points of one set-up of the instrument, with their covariances."""
    return Points.of(
        np.array([each.xyz for each in measured]),
        np.array([each.covariance for each in measured]),
        np.array([each.common for each in measured]),
    )


def plate_of(rows: Rows, most: int | None = None) -> NestPlate | None:
    """The plate as its poses show it, `most` of them at most; None if poses have one reflector."""
    poses = [points_of([row.point, *row.others]) for row in rows.recorded(PoseRow) if row.others]
    return NestPlate.learnt(poses[:most]) if poses else None


def alone(points: Points) -> Points:
    """Points without their common part, by which the plate's pose is found, and so checked."""
    return Points.of(points.xyz, points.alone)


def check_plate(context: StepContext, measured: Sequence[MeasuredPoint]) -> None:
    """Raise NestsDisagree if the distances between the reflectors are not the plate's: one measured twice, swapped."""
    given = reflectors_of(context.cell).on_flange[: len(measured)]
    plate = plate_of(context, most=_FIRST_POSES) or NestPlate.of([one.xyz for one in given], _ROUGH_MM)
    try:
        check_nests(alone(points_of(measured)), plate, tuple(one.id for one in given))
    except NestsDoNotFit as error:
        what, _, cure = str(error).rpartition(": ")
        raise NestsDisagree("tracker", what, cure) from error


_NAMES = ("X", "Y", "Z", "RX", "RY", "RZ")


def measured_place(row: PoseRow, repeatability: float) -> dict[str, float]:
    """X, Y, Z, mm, with their covariance; repeatability: of the robot, 3-D, mm."""
    covariance = points_of([row.point]).alone[0] + repeatability**2 / 3.0 * np.eye(3)
    return {**dict(zip("XYZ", row.point.xyz, strict=True)), **_spread(covariance)}


def measured_pose(plate: NestPlate, row: PoseRow, repeatability: float) -> dict[str, float]:
    """X, Y, Z, mm, and the quaternion of the plate's frame, with their covariance, mm and deg."""
    found = plate_pose(alone(points_of([row.point, *row.others])), plate)
    covariance = found.covariance.copy()
    covariance[:3, :3] += repeatability**2 / 3.0 * np.eye(3)
    scale = np.array([1.0] * 3 + [np.degrees(1.0)] * 3)
    w, x, y, z = Rotation.from_matrix(found.matrix[:3, :3]).as_quat(scalar_first=True).tolist()
    return {
        **dict(zip("XYZ", found.matrix[:3, 3].tolist(), strict=True)),
        "QW": w, "QX": x, "QY": y, "QZ": z,
        **_spread(covariance * np.outer(scale, scale)),
    }  # fmt: skip


def _spread(covariance: Floats) -> dict[str, float]:
    """Columns sX … and cXY … of a covariance (k, k)."""
    names = _NAMES[: len(covariance)]
    sigma = {f"s{name}": float(np.sqrt(covariance[at, at])) for at, name in enumerate(names)}
    return sigma | {f"c{names[i]}{names[j]}": float(covariance[i, j]) for i, j in combinations(range(len(names)), 2)}
