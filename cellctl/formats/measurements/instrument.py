"""Rows that an instrument measured: positions and poses, with the unknown zero of its range, if any."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self, final

from cellctl.formats.columns import Sieve
from cellctl.formats.measurements.kinds import ABC, PLACE, QUATERNION
from cellctl.formats.measurements.sigmas import covariances, place_sigma, rotation_sigma
from cellctl.formats.robot import RobotFile

if TYPE_CHECKING:
    from cellctl.calibration import PoseRows, PositionRows, Postures
    from cellctl.kinematics import Floats


@final
@dataclass(frozen=True, eq=False)
class Positions:
    """xyz, sigma (N, 3), mm; NaN where a row is none. covariance (N, 3, 3), mm², where rows state it. zeros (N)."""

    xyz: Floats
    sigma: Floats
    covariance: Floats | None
    zeros: Sequence[str]

    @classmethod
    def of(cls, sieve: Sieve, robot: RobotFile, rows: Collection[int]) -> Self:
        """The positions at `rows`."""
        import numpy as np

        xyz = np.array([sieve.numbers(name, rows=rows) for name in PLACE]).T
        sigma = place_sigma(sieve, robot, rows)
        return cls(xyz, sigma, covariances(sieve, sigma, rows), sieve.data.texts("zero"))

    def block(self, rows: list[int], at: Postures, session: int, datums: Sequence[str] = ()) -> PositionRows:
        """Those at `rows`, for the estimator, which counts the zeros by `datums`."""
        from cellctl.calibration import PositionRows

        block = PositionRows(at, self.xyz[rows], self.sigma[rows], session)
        if self.covariance is not None:
            block = PositionRows.of(at, self.xyz[rows], self.covariance[rows], session)
        return block.changed(datum=_datum(self.zeros, rows, datums))


@final
@dataclass(frozen=True, eq=False)
class Poses:
    """xyz (N, 3), mm; turns (N, 3 or 4): A, B, C (deg) or a unit quaternion; sigma (N, 6), mm and rad.

    covariance (N, 6, 6), where rows state it. zeros (N): name of the range's unknown zero, empty where it is known.
    """

    xyz: Floats
    turns: Floats
    sigma: Floats
    covariance: Floats | None
    zeros: Sequence[str]

    @classmethod
    def of(cls, sieve: Sieve, robot: RobotFile, rows: Collection[int]) -> Self:
        """The poses at `rows`."""
        import numpy as np

        xyz = np.array([sieve.numbers(name, rows=rows) for name in PLACE]).T
        quaternions = any(any(sieve.data.texts(name)) for name in QUATERNION)
        turns = np.array([sieve.numbers(name, rows=rows) for name in (QUATERNION if quaternions else ABC)]).T
        if quaternions:
            for row in np.flatnonzero(np.abs(np.linalg.norm(turns, axis=1) - 1.0) > 0.01):
                sieve.reject(int(row), "QW, QX, QY, QZ is no unit quaternion")
        sigma = np.hstack([place_sigma(sieve, robot, rows), rotation_sigma(sieve, rows)])
        return cls(xyz, turns, sigma, covariances(sieve, sigma, rows), sieve.data.texts("zero"))

    def block(self, rows: list[int], at: Postures, session: int, datums: Sequence[str] = ()) -> PoseRows:
        """Those at `rows`, for the estimator, which counts the zeros by `datums`."""
        from cellctl.calibration import PoseRows
        from cellctl.kinematics import pose, rotation_from_abc, rotation_from_quaternion

        rotation = rotation_from_quaternion if self.turns.shape[1] == len(QUATERNION) else rotation_from_abc
        poses = pose(rotation(self.turns[rows]), self.xyz[rows])
        block = PoseRows(at, poses, self.sigma[rows], session)
        if self.covariance is not None:
            block = PoseRows.of(at, poses, self.covariance[rows], session)
        return block.changed(datum=_datum(self.zeros, rows, datums))


def _datum(zeros: Sequence[str], rows: list[int], datums: Sequence[str]) -> Any:
    """Number of each row's zero (N,) among `datums`, −1 for none; None where no row has one."""
    import numpy as np

    numbers = {name: number for number, name in enumerate(datums)}
    found = np.array([numbers.get(zeros[row], -1) for row in rows])
    return found if (found >= 0).any() else None
