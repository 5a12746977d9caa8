"""The pose of a plate from its reflector nests, measured one after another with one reflector.

The distances between the nests do not depend on the plate's pose. They show a nest measured twice, two nests taken for
each other, and a reflector that does not sit in its nest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations
from typing import Any, final

import numpy as np
from numpy.typing import ArrayLike

from cellctl.calibration.distributions import normal_ppf
from cellctl.kinematics import Floats, pose
from cellctl.metrology.measured_points import Points, block_diagonal
from cellctl.metrology.measured_pose import MeasuredPose, rigid_transform

UNLIKELY = 1e-4
"""Probability below which measured distances do not fit the plate."""

_LEARNING_STEPS = 4
"""Each averages the measurements about the plate of the step before; the second is exact to a nanometre."""


class NestsDoNotFit(ValueError):
    """The distances between measured nests are not those of the plate; the text says which, by how much, what to do."""


class NestMeasuredTwice(NestsDoNotFit):
    """Two measurements are of the same nest."""


class NestsSwapped(NestsDoNotFit):
    """The measurements fit the plate in another order."""


@final
@dataclass(frozen=True, eq=False)
class NestPlate:
    """Nests in the plate's own frame. xyz (N, 3), mm, N ≥ 3; covariance (3N, 3N), mm², of a certificate or a survey."""

    xyz: Floats
    covariance: Floats

    @classmethod
    def of(cls, xyz: ArrayLike, sigma_mm: float = 0.0) -> NestPlate:
        """From places (N, 3), mm, with one σ on each coordinate. Raises ValueError for fewer than three, or a line."""
        places = np.asarray(xyz, float)
        if places.ndim != 2 or len(places) < 3 or np.linalg.svd(places - places.mean(axis=0))[1][1] < 1.0:
            raise ValueError("a plate needs three nests that are not on a line")
        return cls(places, sigma_mm**2 * np.eye(places.size))

    @classmethod
    def learnt(cls, measured: Sequence[Points]) -> NestPlate:
        """From its nests, measured at K ≥ 1 poses: origin at the first, x to the second, z along (2 − 1) × (3 − 1).

        The mean of the measurements, each carried back to the plate; the covariance is a K-th of one measurement's. The
        common part of the points' error does not change the plate, and is left out.
        """
        xyz = _in_own_frame(measured[0].xyz)
        for _ in range(_LEARNING_STEPS if len(measured) > 1 else 1):
            frames = [rigid_transform(xyz, one.xyz, block_diagonal(one.alone)).pose.matrix for one in measured]
            carried = [(one.xyz - at[:3, 3]) @ at[:3, :3] for one, at in zip(measured, frames, strict=True)]
            xyz = _in_own_frame(np.mean(carried, axis=0))
        turned = [at[:3, :3].T @ one.alone @ at[:3, :3] for one, at in zip(measured, frames, strict=True)]
        return cls(xyz, block_diagonal(np.mean(turned, axis=0) / len(measured)))

    def ordered(self, order: Any) -> NestPlate:
        """The nests in another order: indices (N,)."""
        count = len(self.xyz)
        blocks = self.covariance.reshape(count, 3, count, 3)[order][:, :, order]
        return NestPlate(self.xyz[order], blocks.reshape(3 * count, 3 * count))


def _in_own_frame(xyz: Floats) -> Floats:
    frame = frame_of(xyz)
    return np.asarray((xyz - frame[:3, 3]) @ frame[:3, :3])


def frame_of(xyz: Floats) -> Floats:
    """Frame (4, 4) by three points: origin at the first, x to the second, z along (2 − 1) × (3 − 1)."""
    along, other = xyz[1] - xyz[0], xyz[2] - xyz[0]
    x, z = along / np.linalg.norm(along), np.cross(along, other)
    z = z / np.linalg.norm(z)
    return pose(np.column_stack([x, np.cross(z, x), z]), xyz[0])


def plate_pose(measured: Points, plate: NestPlate, names: tuple[str, ...] = ()) -> MeasuredPose:
    """Pose of the plate's frame in the instrument's, with covariance (6, 6), from its nests in the plate's order.

    names: of the nests, for messages. The plate's own uncertainty is in it: that part is the same in every pose of one
    plate. Raises NestMeasuredTwice, NestsSwapped or NestsDoNotFit.
    """
    check_nests(measured, plate, names)
    rough = rigid_transform(plate.xyz, measured.xyz, measured.joint_covariance())
    turn = np.kron(np.eye(len(plate.xyz)), rough.pose.matrix[:3, :3])
    whole = measured.joint_covariance() + turn @ plate.covariance @ turn.T
    return rigid_transform(plate.xyz, measured.xyz, whole).pose


def check_nests(measured: Points, plate: NestPlate, names: tuple[str, ...] = ()) -> None:
    """Raise NestMeasuredTwice, NestsSwapped or NestsDoNotFit where the distances are not the plate's."""
    count = len(plate.xyz)
    names = names or tuple(str(number) for number in range(1, count + 1))
    if len(measured) != count:
        raise NestsDoNotFit(f"{len(measured)} measurements of {count} nests: measure each nest once")
    if _fits(measured, plate, range(count)):
        return
    pairs = _pairs(count)
    off, sigma = _differences(measured, plate, pairs)
    expected = _lengths(plate.xyz, pairs)
    for (i, j), difference, wanted, one in zip(pairs, off, expected, sigma, strict=True):
        if wanted + difference < min(0.2 * wanted, max(5.0 * one, 1.0)):
            raise NestMeasuredTwice(
                f"nests {names[j]} and {names[i]} are {wanted + difference:.3f} mm apart and should be {wanted:.3f}: "
                f"one nest was measured twice; measure both again"
            )
    for order in permutations(range(count)):
        if _fits(measured, plate, order):
            seen = ", ".join(names[place] for place in order)
            raise NestsSwapped(
                f"the measurements of nests {', '.join(names)} fit the plate in the order {seen}: "
                f"correct the order of the nests, or their names in the cell file"
            )
    worst = int(np.argmax(np.abs(off) / sigma))
    i, j = pairs[worst]
    raise NestsDoNotFit(
        f"nests {names[j]} and {names[i]} are {expected[worst] + off[worst]:.3f} mm apart, {off[worst]:+.3f} from the "
        f"plate's {expected[worst]:.3f} (σ {sigma[worst]:.3f}): clean nests and reflector, and measure again"
    )


def _fits(measured: Points, plate: NestPlate, order: Sequence[int]) -> bool:
    """Whether every distance fits, if measurement k is of nest order[k]; Bonferroni over the distances."""
    pairs = _pairs(len(order))
    off, sigma = _differences(measured, plate.ordered(list(order)), pairs)
    return bool((np.abs(off) < -normal_ppf(UNLIKELY / (2.0 * len(pairs))) * sigma).all())


def _pairs(count: int) -> list[tuple[int, int]]:
    return [(i, j) for i in range(count) for j in range(i)]


def _differences(measured: Points, plate: NestPlate, pairs: list[tuple[int, int]]) -> tuple[Floats, Floats]:
    """Measured less the plate's distances, and their standard deviations, mm."""
    seen, nominal = _length_rows(measured.xyz, pairs), _length_rows(plate.xyz, pairs)
    spread = seen @ measured.joint_covariance() @ seen.T + nominal @ plate.covariance @ nominal.T
    return _lengths(measured.xyz, pairs) - _lengths(plate.xyz, pairs), np.sqrt(np.diag(spread))


def _lengths(xyz: Floats, pairs: list[tuple[int, int]]) -> Floats:
    return np.array([np.linalg.norm(xyz[i] - xyz[j]) for i, j in pairs])


def _length_rows(xyz: Floats, pairs: list[tuple[int, int]]) -> Floats:
    """Derivative (pairs, 3N) of the distances by the points."""
    rows = np.zeros((len(pairs), len(xyz), 3))
    for row, (i, j) in enumerate(pairs):
        unit = (xyz[i] - xyz[j]) / max(float(np.linalg.norm(xyz[i] - xyz[j])), 1e-9)
        rows[row, i], rows[row, j] = unit, -unit
    return rows.reshape(len(pairs), -1)
