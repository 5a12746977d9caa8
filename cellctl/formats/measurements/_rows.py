"""Rows of a data set as rows of the fit: measured by an instrument, or with the tool at fixed objects."""

from __future__ import annotations

import abc
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any, Self, final

import numpy as np

from cellctl.calibration import Measured, PlaneRows, PoseRows, PositionRows, Postures, SocketRows, TouchRows
from cellctl.files import InputError, Problem
from cellctl.formats.artefact import Artefact
from cellctl.formats.dataset import DataSet, Sieve
from cellctl.formats.measurements.columns import (
    ABC,
    PLACE,
    QUATERNION,
    covariances,
    distance_sigma,
    place_sigma,
    rotation_sigma,
)
from cellctl.kinematics import Floats, pose, rotation_from_abc, rotation_from_quaternion
from cellctl.robot_file import RobotFile


class Reading(abc.ABC):
    """The cells of one kind of rows as numbers, for all N rows of a data set."""

    def point_name(self, row: int) -> str:
        """The name of the row's fixed point; empty: it has none."""
        return ""

    def zero_name(self, row: int) -> str:
        """The name of the unknown zero of the row's length; empty: there is none."""
        return ""

    @abc.abstractmethod
    def block(self, rows: list[int], at: Postures, session: int, points: Any, datums: Sequence[str]) -> Measured:
        """Those at `rows`, for the estimator: at the fixed points of numbers `points`, −1 for none; zeros are counted
        by their place in `datums`.
        """


@final
@dataclass(frozen=True, eq=False)
class Positions(Reading):
    """xyz, sigma (N, 3), mm; NaN where a row is none. covariance (N, 3, 3), mm², where rows state it. zeros (N)."""

    xyz: Floats
    sigma: Floats
    covariance: Floats | None
    zeros: Sequence[str]

    @classmethod
    def of(cls, sieve: Sieve, robot: RobotFile, rows: Collection[int], artefact: Artefact | None) -> Self:
        """The positions at `rows`."""
        xyz = np.array([sieve.numbers(name, rows=rows) for name in PLACE]).T
        sigma = place_sigma(sieve, robot, rows)
        return cls(xyz, sigma, covariances(sieve, sigma, rows), sieve.data.texts("zero"))

    def zero_name(self, row: int) -> str:
        """The name of the range's unknown zero."""
        return self.zeros[row]

    def block(self, rows: list[int], at: Postures, session: int, points: Any, datums: Sequence[str]) -> PositionRows:
        """See `Reading`."""
        block = PositionRows(at, self.xyz[rows], self.sigma[rows], session)
        if self.covariance is not None:
            block = PositionRows.of(at, self.xyz[rows], self.covariance[rows], session)
        return block.changed(datum=_datum(self.zeros, rows, datums))


@final
@dataclass(frozen=True, eq=False)
class Poses(Reading):
    """xyz (N, 3), mm; turns (N, 3 or 4): A, B, C (deg) or a unit quaternion; sigma (N, 6), mm and rad.

    covariance (N, 6, 6), where rows state it. zeros (N): name of the range's unknown zero, empty where it is known.
    """

    xyz: Floats
    turns: Floats
    sigma: Floats
    covariance: Floats | None
    zeros: Sequence[str]

    @classmethod
    def of(cls, sieve: Sieve, robot: RobotFile, rows: Collection[int], artefact: Artefact | None) -> Self:
        """The poses at `rows`."""
        xyz = np.array([sieve.numbers(name, rows=rows) for name in PLACE]).T
        quaternions = any(any(sieve.data.texts(name)) for name in QUATERNION)
        turns = np.array([sieve.numbers(name, rows=rows) for name in (QUATERNION if quaternions else ABC)]).T
        if quaternions:
            for row in np.flatnonzero(np.abs(np.linalg.norm(turns, axis=1) - 1.0) > 0.01):
                sieve.reject(int(row), "QW, QX, QY, QZ is no unit quaternion")
        sigma = np.hstack([place_sigma(sieve, robot, rows), rotation_sigma(sieve, rows)])
        return cls(xyz, turns, sigma, covariances(sieve, sigma, rows), sieve.data.texts("zero"))

    def zero_name(self, row: int) -> str:
        """The name of the range's unknown zero."""
        return self.zeros[row]

    def block(self, rows: list[int], at: Postures, session: int, points: Any, datums: Sequence[str]) -> PoseRows:
        """See `Reading`."""
        rotation = rotation_from_quaternion if self.turns.shape[1] == len(QUATERNION) else rotation_from_abc
        poses = pose(rotation(self.turns[rows]), self.xyz[rows])
        block = PoseRows(at, poses, self.sigma[rows], session)
        if self.covariance is not None:
            block = PoseRows.of(at, poses, self.covariance[rows], session)
        return block.changed(datum=_datum(self.zeros, rows, datums))


def _datum(zeros: Sequence[str], rows: list[int], datums: Sequence[str]) -> Any:
    """Number of each row's zero (N,) among `datums`, −1 for none; None where no row has one."""
    numbers = {name: number for number, name in enumerate(datums)}
    found = np.array([numbers.get(zeros[row], -1) for row in rows])
    return found if (found >= 0).any() else None


AGREE_MM = 1e-3
"""Largest difference between data set and artefact file that is no contradiction."""


@final
@dataclass(frozen=True, eq=False)
class Reaches(Reading):
    """Distances from fixed points. names (N): of the point, empty where a row is none; reach (N,), sigma (N, 1), mm.
    zeros (N): name of the zero of each reach, empty where that is known.
    """

    names: Sequence[str]
    reach: Floats
    sigma: Floats
    zeros: Sequence[str]

    @classmethod
    def of_touches(cls, sieve: Sieve, robot: RobotFile, rows: Collection[int], artefact: Artefact | None) -> Self:
        """Touches at `rows`: sphere radius plus tip radius."""
        names = sieve.data.texts("sphere")
        reach = np.array(_touched(sieve, artefact, names, rows))
        return cls(names, reach, distance_sigma(sieve, robot, rows), [""] * len(names))

    @classmethod
    def of_distances(cls, sieve: Sieve, robot: RobotFile, rows: Collection[int], artefact: Artefact | None) -> Self:
        """Distances at `rows`, as shown by a ball-bar or a draw-wire."""
        names, reach = sieve.data.texts("anchor"), sieve.numbers("distance", rows=rows)
        zeros = sieve.data.texts("zero")
        for row in rows:
            if not names[row]:
                sieve.reject(row, "anchor is missing")
            elif reach[row] <= 0.0 and not zeros[row]:
                sieve.reject(row, f"distance is {reach[row]:g}")
        return cls(names, np.array(reach), distance_sigma(sieve, robot, rows), zeros)

    def point_name(self, row: int) -> str:
        """The name of the point."""
        return self.names[row]

    def zero_name(self, row: int) -> str:
        """The name of the length's unknown zero."""
        return self.zeros[row]

    def block(self, rows: list[int], at: Postures, session: int, points: Any, datums: Sequence[str]) -> TouchRows:
        """See `Reading`."""
        numbers = {name: number for number, name in enumerate(datums)}
        datum = np.array([numbers.get(self.zeros[row], -1) for row in rows])
        return TouchRows(at, points, self.reach[rows], self.sigma[rows], session, datum)


@final
@dataclass(frozen=True, eq=False)
class Sockets(Reading):
    """The tool held in sockets. names (N): of the socket, empty where a row is none; sigma (N, 3), mm."""

    names: Sequence[str]
    sigma: Floats

    @classmethod
    def of(cls, sieve: Sieve, robot: RobotFile, rows: Collection[int], artefact: Artefact | None) -> Self:
        """Visits of sockets at `rows`."""
        names = sieve.data.texts("socket")
        for row in rows:
            if not names[row]:
                sieve.reject(row, "socket is missing")
        return cls(names, place_sigma(sieve, robot, rows))

    def point_name(self, row: int) -> str:
        """The name of the socket."""
        return self.names[row]

    def block(self, rows: list[int], at: Postures, session: int, points: Any, datums: Sequence[str]) -> SocketRows:
        """See `Reading`."""
        return SocketRows(at, points, self.sigma[rows], session)


@final
@dataclass(frozen=True, eq=False)
class Planes(Reading):
    """Touches on planes. names (N): of the plane, empty where a row is none; reach (N,), sigma (N, 1), mm."""

    names: Sequence[str]
    reach: Floats
    sigma: Floats

    @classmethod
    def of(cls, sieve: Sieve, robot: RobotFile, rows: Collection[int], artefact: Artefact | None) -> Self:
        """Touches at `rows`: by tip radius plus drift. A plane that the artefact has as a point, or not at all where it
        has planes, is rejected.
        """
        names, known = sieve.data.texts("plane"), [plane.id for plane in artefact.planes] if artefact else []
        points = {point.id for point in artefact.points} if artefact else set()
        drift = sieve.numbers("drift", missing=0.0, rows=rows)
        for row in rows:
            if not names[row]:
                sieve.reject(row, "plane is missing")
            elif names[row] in points:
                sieve.reject(row, f"'{names[row]}' is a point in the artefact, and no plane")
            elif known and names[row] not in known:
                sieve.reject(row, f"plane '{names[row]}' is not in the artefact")
        reach = np.array(_tip_radii(sieve, artefact, rows)) + np.array(drift)
        return cls(names, reach, distance_sigma(sieve, robot, rows))

    def point_name(self, row: int) -> str:
        """The name of the plane."""
        return self.names[row]

    def block(self, rows: list[int], at: Postures, session: int, points: Any, datums: Sequence[str]) -> PlaneRows:
        """See `Reading`."""
        return PlaneRows(at, points, self.reach[rows], self.sigma[rows], session)


def check_orientation(data: DataSet, artefact: Artefact | None) -> None:
    """Raise InputError where poses have no orientation, or two."""
    if not any(data.has(*names) for names in (ABC, QUATERNION)):
        what = "has no orientation: A, B, C or QW, QX, QY, QZ"
        raise InputError(Problem(data.file, 1, 0, what, "--measure position"))
    if all(any(any(data.texts(name)) for name in names) for names in (ABC, QUATERNION)):
        what = "gives the orientation in two ways: A, B, C and QW, QX, QY, QZ"
        raise InputError(Problem(data.file, 1, 0, what, "keep one"))


def check_radii(data: DataSet, artefact: Artefact | None) -> None:
    """Raise InputError where nothing says how large the touched spheres are."""
    if artefact is None and not data.has("radius"):
        what = "has touches on spheres, but neither a column radius nor an artefact says how large these are"
        raise InputError(Problem(data.file, 1, 0, what, "give --artefact FILE (the cell file does)"))


def reject_point_names(sieve: Sieve, on_plane: Sequence[bool], names: Sequence[str]) -> None:
    """Reject the touches on a plane whose name another row uses for a point: the two cannot be the same object."""
    first: dict[str, int] = {}
    for row, (plane, name) in enumerate(zip(on_plane, names, strict=True)):
        if not plane:
            first.setdefault(name, row)
    for row, (plane, name) in enumerate(zip(on_plane, names, strict=True)):
        if plane and name in first:
            sieve.reject(row, f"'{name}' is a plane here and a point in line {sieve.data.lines[first[name]]}")


def _touched(sieve: Sieve, artefact: Artefact | None, names: list[str], rows: Collection[int]) -> list[float]:
    """Sphere radius plus tip radius plus `drift` for each row, mm. A `radius` other than the artefact's is rejected."""
    tips = _tip_radii(sieve, artefact, rows)
    given = sieve.numbers("radius", missing=0.0, rows=rows)
    drift = sieve.numbers("drift", missing=0.0, rows=rows)
    result = [0.0] * len(names)
    for row in rows:
        name, radius = names[row], given[row]
        sphere = artefact.sphere(name) if artefact else None
        known = sphere.diameter / 2.0 if sphere else radius
        if not name:
            sieve.reject(row, "sphere is missing")
        elif artefact and sphere is None:
            sieve.reject(row, f"sphere '{name}' is not in the artefact")
        elif radius < 0.0 or known <= 0.0:
            sieve.reject(row, "radius is missing" if radius == 0.0 else f"radius is {radius:g}")
        elif radius and abs(radius - known) > AGREE_MM:
            sieve.reject(row, f"radius {radius:g}, but the artefact says {known:g} mm for '{name}'")
        result[row] = known + tips[row] + drift[row]
        if result[row] <= 0.0:
            sieve.reject(row, f"radius + tip radius + drift is {result[row]:g}")
    return result


def _tip_radii(sieve: Sieve, artefact: Artefact | None, rows: Collection[int]) -> list[float]:
    """Radius of the tip for each row, mm. A `tip_radius` other than the artefact's is rejected."""
    given, column = sieve.numbers("tip_radius", missing=0.0, rows=rows), sieve.data.texts("tip_radius")
    for row in rows:
        if given[row] < 0.0:
            sieve.reject(row, f"tip_radius is {given[row]:g}")
        elif artefact and column[row] and abs(given[row] - artefact.tip_radius) > AGREE_MM:
            sieve.reject(row, f"tip_radius {given[row]:g}, but the artefact says {artefact.tip_radius:g} mm")
    return [artefact.tip_radius] * len(column) if artefact else given
