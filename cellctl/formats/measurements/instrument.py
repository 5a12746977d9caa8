"""Rows that an instrument measured: positions and poses."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import TYPE_CHECKING, Self, final

from cellctl.formats.columns import Sieve
from cellctl.formats.measurements.kinds import ABC, PLACE, QUATERNION
from cellctl.formats.measurements.sigmas import place_sigma, rotation_sigma
from cellctl.formats.robot import RobotFile

if TYPE_CHECKING:
    from cellctl.calibration import PoseRows, PositionRows, Postures
    from cellctl.kinematics import Floats


@final
@dataclass(frozen=True, eq=False)
class Positions:
    """xyz, sigma (N, 3), mm; NaN where a row is none."""

    xyz: Floats
    sigma: Floats

    @classmethod
    def of(cls, sieve: Sieve, robot: RobotFile, rows: Collection[int]) -> Self:
        """The positions at `rows`."""
        import numpy as np

        xyz = np.array([sieve.numbers(name, rows=rows) for name in PLACE]).T
        return cls(xyz, place_sigma(sieve, robot, rows))

    def block(self, rows: list[int], at: Postures, session: int) -> PositionRows:
        """Those at `rows`, for the estimator."""
        from cellctl.calibration import PositionRows

        return PositionRows(at, self.xyz[rows], self.sigma[rows], session)


@final
@dataclass(frozen=True, eq=False)
class Poses:
    """xyz (N, 3), mm; turns (N, 3 or 4): A, B, C (deg) or a unit quaternion; sigma (N, 6), mm and rad."""

    xyz: Floats
    turns: Floats
    sigma: Floats

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
        return cls(xyz, turns, np.hstack([place_sigma(sieve, robot, rows), rotation_sigma(sieve, rows)]))

    def block(self, rows: list[int], at: Postures, session: int) -> PoseRows:
        """Those at `rows`, for the estimator."""
        from cellctl.calibration import PoseRows
        from cellctl.kinematics import pose, rotation_from_abc, rotation_from_quaternion

        rotation = rotation_from_quaternion if self.turns.shape[1] == len(QUATERNION) else rotation_from_abc
        return PoseRows(at, pose(rotation(self.turns[rows]), self.xyz[rows]), self.sigma[rows], session)
