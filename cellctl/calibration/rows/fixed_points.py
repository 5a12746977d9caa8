"""The tool at fixed objects in unknown places: spheres, ball-bars, draw-wires, sockets, planes; certified distances.

A normal n and an offset d (the plane: n·x = d) are four numbers for three unknowns. `State.points` holds the *pole* of
each plane, p = ρ s n with s = 1000 mm and ρ = x + √(x² + 1), x = d/s, so that n = p/|p| and d = s (ρ − 1/ρ)/2. Every
plane with a side has one pole and every pole except 0 has one plane; a plane through the origin is no special case.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self, final

import numpy as np

from cellctl.calibration.model.postures import At
from cellctl.calibration.model.robot_model import RobotModel
from cellctl.calibration.model.unknowns import State
from cellctl.calibration.rows._kind import Reachable, RowsAtJoints, with_points
from cellctl.kinematics import Floats
from cellctl.kinematics.low_discrepancy import evenly

CENTRE_STEPS = 8
"""Of Gauss–Newton at the most; it ends where a step comes no closer."""

RCOND = 1e-6
"""Directions whose singular value is below this share of the greatest are left alone: a cap so small that it shows no
curvature, or points on a line."""


def sphere_centre(tcps: Floats, reach: Any) -> Floats:
    """Centre (3,) of the sphere of radius `reach` (N,), mm, that fits the points `tcps` (N, 3) best.

    From the linear problem |p|² − ρ² = 2 p·c + k about the points' mean, and from both sides of the points along the
    direction of least spread, as the linear problem cannot determine the curvature of a small cap; then Gauss–Newton on
    the distances; the best fit is taken. Fewer than four points give the admissible centre nearest to the mean.
    """
    reach = np.broadcast_to(np.asarray(reach, float), len(tcps))
    mean = tcps.mean(axis=0)
    away = tcps - mean
    lines = np.concatenate([2.0 * away, np.ones((len(tcps), 1))], axis=1)
    linear = np.linalg.lstsq(lines, np.sum(away**2, axis=1) - reach**2, rcond=RCOND)[0][:3]
    across = reach.mean() * np.linalg.eigh(away.T @ away)[1][:, 0]
    found = [_nearer_centre(away, reach, start) for start in (linear, across, -across)]
    return np.asarray(mean + min(found, key=lambda centre: _off_surface(away, reach, centre)))


def _nearer_centre(points: Floats, reach: Floats, centre: Floats) -> Floats:
    """Gauss–Newton on the points' distances from `centre` (3,), while these get closer to `reach`."""
    for _ in range(CENTRE_STEPS):
        away = points - centre
        distance = np.maximum(np.linalg.norm(away, axis=1), 1e-9)
        tried = centre + np.linalg.lstsq(-away / distance[:, None], reach - distance, rcond=RCOND)[0]
        if _off_surface(points, reach, tried) >= _off_surface(points, reach, centre):
            break
        centre = tried
    return centre


def _off_surface(points: Floats, reach: Floats, centre: Floats) -> float:
    return float(np.sum((np.linalg.norm(points - centre, axis=1) - reach) ** 2))


_RIDGE = 1e-10
"""Share of the largest diagonal element: enough to solve where base and tool cannot be separated."""


def least_squares(lines: Floats, right: Floats) -> Floats:
    """Least squares (C, k) of batches (C, M, k) and (C, M), by normal equations, slightly regularised."""
    turned = lines.swapaxes(-1, -2)
    normal = np.matmul(turned, lines)
    largest = np.diagonal(normal, axis1=-2, axis2=-1).max(axis=-1)
    held: Any = normal + _RIDGE * largest[:, None, None] * np.eye(normal.shape[-1])
    return np.asarray(np.linalg.solve(held, np.matmul(turned, right[..., None]))[..., 0])


def _from_their_mean(tcps: Floats) -> Floats:
    """Squared distances (C, N) of `tcps` (C, N, 3) from the socket that fits them best."""
    return np.asarray(np.sum((tcps - tcps.mean(axis=1, keepdims=True)) ** 2, axis=-1))


def _from_their_plane(tcps: Floats) -> Floats:
    """Squared distances (C, N) from the plane that fits `tcps` (C, N, 3), of balls of one size, best."""
    away = tcps - tcps.mean(axis=1, keepdims=True)
    normal = np.linalg.eigh(np.matmul(away.swapaxes(1, 2), away))[1][..., :1]
    return np.asarray(np.matmul(away, normal)[..., 0] ** 2)


def _from_their_sphere(tcps: Floats, reach: Floats, shifted: bool) -> Floats:
    """Squared distances (C, N) from the surface of the sphere that fits `tcps` (C, N, 3) best.

    shifted: its radius and `reach` (N,) differ by an unknown amount z, the datum. Then |p − c| = ρ − z, and

        |p|² − ρ² = 2 p·c − 2 ρ z + k,    k = z² − |c|²,

    is linear in c, z and k, about the points' mean; ρ is counted from its mean, which changes z alone.
    """
    if tcps.shape[1] < 5 + shifted:  # 4 or 5 unknowns fit so few exactly, for every candidate: rank by their extent
        return _from_their_mean(tcps)
    away = tcps - tcps.mean(axis=1, keepdims=True)
    unit, own = np.ones((*away.shape[:2], 1)), reach - reach.mean() if shifted else reach
    besides = [np.broadcast_to(-2.0 * own[:, None], unit.shape)] if shifted else []
    lines = np.concatenate([2.0 * away, unit, *besides], axis=-1)
    found = least_squares(lines, np.sum(away**2, axis=-1) - own**2)
    length = own - found[:, 4:] if shifted else own
    return np.asarray((np.linalg.norm(away - found[:, None, :3], axis=-1) - length) ** 2)


@final
@dataclass(frozen=True, eq=False)
class TouchRows(RowsAtJoints):
    """Distances from an unknown point: touches on a sphere, a ball-bar about its socket, a draw-wire from its outlet.

    at (N): postures; point (N,): index of the point (a sphere's centre); reach (N,): measured distance, mm (for a touch
    sphere radius + tip radius); sigma (N, 1), mm, along the line between. datum (N,): index of the unknown zero of the
    row's instrument, by which the reach exceeds the distance; -1: none. None: none in any row.
    """

    at: At
    point: Any
    reach: Floats
    sigma: Floats
    session: int = 0
    datum: Any = None

    one: ClassVar[str] = "distance"
    many: ClassVar[str] = "distances"
    along_line: ClassVar[bool] = True
    noun: ClassVar[str] = "sphere"
    visits: ClassVar[str] = "touches"
    visits_at_least: ClassVar[int] = 4
    in_setup_check: ClassVar[bool] = True

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.datum is None:
            object.__setattr__(self, "datum", np.full(len(self), -1))

    @property
    def quantities(self) -> tuple[str, ...]:
        """One distance."""
        return ("distance",)

    def residual(self, state: State) -> Floats:
        """The tool's distance from the point less the measured one (N, 1), mm."""
        away = self._model(state).tcp(self.postures) - state.points[self.point]
        return np.asarray(np.linalg.norm(away, axis=-1) - self.lengths(state))[:, None]

    def jacobian(self, state: State) -> Floats:
        """(N, 1, P): the TCP's motion along the line between, less the point's; 1 for the row's datum."""
        model, normal = self._model(state), self.normals(state)
        along = np.einsum("nr,nrp->np", normal, model.jacobian(self.postures)[:, :3])[:, None]
        result = with_points(along, -normal[:, None], self.point, state, self.session)
        unsure = np.flatnonzero(self.datum >= 0)
        result[unsure, 0, state.datums_at + self.datum[unsure]] = 1.0
        return result

    def errors(self, state: State) -> Floats:
        """Difference from the measured distance (N,), mm: of a touch, the distance to the sphere's surface."""
        return np.abs(self.residual(state)[:, 0])

    @property
    def zeros(self) -> Any:
        """Each row's datum (N,)."""
        return self.datum

    @property
    def distances(self) -> Floats:
        """The measured distances (N,), mm."""
        return self.reach

    def with_distances(self, distances: Floats) -> Self:
        """Other measured distances (N,), mm."""
        return replace(self, reach=distances)

    def place(self, model: RobotModel) -> Floats:
        """The centre (3,), mm, of the sphere that the TCPs lie on."""
        return sphere_centre(model.tcp(self.postures), self.reach)

    def normals(self, state: State) -> Floats:
        """Unit vectors (N, 3) from each row's point to the TCP."""
        away = self._model(state).tcp(self.postures) - state.points[self.point]
        return np.asarray(away / np.maximum(np.linalg.norm(away, axis=-1, keepdims=True), 1e-9))

    def proposed(self, state: State, reachable: Reachable) -> Self:
        """At the same points in turn, within the directions of approach used before."""
        point, lengths = _in_turn(self.point, reachable.tried), self.lengths(state)
        usual = {name: float(np.median(lengths[self.point == name])) for name in np.unique(self.point)}
        away, normals = np.array([usual[name] for name in point]), self._approaches(state, point)
        at, chosen = reachable.at(state.points[point] + away[:, None] * normals, normals)
        last = np.full(int(self.point.max()) + 1, -1)  # the datum of the last measurement to each point
        last[self.point] = self.datum
        datum = last[point[chosen]]
        reach = away[chosen] + np.append(state.datums, 0.0)[datum]
        sigma = self.usual_sigma(len(at))
        return replace(self, at=at, point=point[chosen], reach=reach, sigma=sigma, datum=datum)

    def _approaches(self, state: State, point: Any) -> Floats:
        """A direction (M, 3) from each of `point` (M,), in the widest cone about their mean that was touched there."""
        measured, samples = self.normals(state), evenly(2, len(point))
        result = np.zeros((len(point), 3))
        for name in np.unique(point):
            mine, seen = point == name, measured[self.point == name]
            middle = seen.mean(axis=0)
            middle = middle / max(float(np.linalg.norm(middle)), 1e-12)
            cosine = 1.0 - samples[mine, 0] * (1.0 - float((seen @ middle).min()))
            result[mine] = _about(middle, cosine, 2.0 * np.pi * samples[mine, 1])
        return result

    def anywhere(self, state: State) -> Floats:
        """TCPs (N, 3) that touch each row's sphere from any side."""
        normals = np.random.default_rng(len(self)).normal(size=(len(self), 3))
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        return np.asarray(state.points[self.point] + self.lengths(state)[:, None] * normals)

    def squared_misfits(self, tcps: Floats) -> Floats:
        """From the sphere of each point and datum."""
        pairs = np.column_stack([self.point, self.datum])
        groups = [(pair[1] >= 0, np.all(pairs == pair, axis=1)) for pair in np.unique(pairs, axis=0)]
        found = [_from_their_sphere(tcps[:, mine], self.reach[mine], shifted) for shifted, mine in groups]
        return np.concatenate(found, axis=1)


@final
@dataclass(frozen=True, eq=False)
class SocketRows(RowsAtJoints):
    """The tool repeatedly at an unknown point: a ball held in a socket, a tip in a cone.

    at (N): postures; point (N,): index of the socket; sigma (N, 3), mm.
    """

    at: At
    point: Any
    sigma: Floats
    session: int = 0

    one: ClassVar[str] = "socket visit"
    many: ClassVar[str] = "socket visits"
    has_length: ClassVar[bool] = False
    noun: ClassVar[str] = "socket"
    visits: ClassVar[str] = "visits"
    visits_at_least: ClassVar[int] = 2
    at_point: ClassVar[bool] = True
    in_setup_check: ClassVar[bool] = True
    model_error_scale: ClassVar[float] = 1.5

    @property
    def quantities(self) -> tuple[str, ...]:
        """Three coordinates."""
        return ("socket",) * 3

    def residual(self, state: State) -> Floats:
        """The tool's place less the socket's (N, 3), mm."""
        return np.asarray(self._model(state).tcp(self.postures) - state.points[self.point])

    def jacobian(self, state: State) -> Floats:
        """(N, 3, P)."""
        columns = self._model(state).jacobian(self.postures)[:, :3]
        turned = np.broadcast_to(-np.eye(3), (len(self), 3, 3))
        return with_points(columns, turned, self.point, state, self.session)

    def errors(self, state: State) -> Floats:
        """3-D distance (N,) from the socket, mm."""
        return np.asarray(np.linalg.norm(self.residual(state), axis=-1))

    def proposed(self, state: State, reachable: Reachable) -> Self:
        """In the same sockets in turn."""
        point = _in_turn(self.point, reachable.tried)
        at, chosen = reachable.at(state.points[point])
        return replace(self, at=at, point=point[chosen], sigma=self.usual_sigma(len(at)))

    def squared_misfits(self, tcps: Floats) -> Floats:
        """From each socket."""
        found = [_from_their_mean(tcps[:, self.point == index]) for index in np.unique(self.point)]
        return np.concatenate(found, axis=1)


def _in_turn(point: Any, count: int) -> Any:
    """The different points among `point` (N,), in turn (count,)."""
    names = np.unique(point)
    return names[np.arange(count) % len(names)]


def _about(middle: Floats, cosine: Floats, turn: Floats) -> Floats:
    """Unit vectors (M, 3) at the angle arccos `cosine` (M,) from `middle` (3,), turned about it by `turn` (M,), rad."""
    x = np.cross(np.eye(3)[np.abs(middle).argmin()], middle)
    x = x / max(float(np.linalg.norm(x)), 1e-12)
    y, sine = np.cross(middle, x), np.sqrt(np.maximum(1.0 - cosine**2, 0.0))
    across = np.cos(turn)[:, None] * x + np.sin(turn)[:, None] * y
    return np.asarray(cosine[:, None] * middle + sine[:, None] * across)


SCALE_MM = 1000.0
"""About how far planes are from the frame's origin: there, 1 mm of the pole is 1 mm of offset, or 1 mrad of tilt."""

ACROSS_MM = 300.0
"""Largest shift of a touch on a plane along each axis (`anywhere`)."""

CARRIED_MM = 30.0
"""A part of the robot further from the TCP than this, on average, shows the side of the touch: a nearer one (a flange
at the tool's tip) may be on either side of the plane by its own error."""


@final
@dataclass(frozen=True, eq=False)
class PlaneRows(RowsAtJoints):
    """Touches on unknown planes by a ball.

    at (N): postures; point (N,): index of the plane; reach (N,): radius of the ball, mm, by which its centre is off the
    plane on the side that the normal points to; sigma (N, 1), mm, along the normal.
    """

    at: At
    point: Any
    reach: Floats
    sigma: Floats
    session: int = 0

    one: ClassVar[str] = "plane touch"
    many: ClassVar[str] = "plane touches"
    of_planes: ClassVar[bool] = True
    has_length: ClassVar[bool] = False
    along_line: ClassVar[bool] = True
    noun: ClassVar[str] = "plane"
    visits: ClassVar[str] = "touches"
    visits_at_least: ClassVar[int] = 4
    in_setup_check: ClassVar[bool] = True

    @property
    def quantities(self) -> tuple[str, ...]:
        """One distance from a plane."""
        return ("plane",)

    def residual(self, state: State) -> Floats:
        """The tool's distance from the plane less the ball's radius (N, 1), mm."""
        normal, offset = planes_of(state.points[self.point])
        along = np.sum(normal * self._model(state).tcp(self.postures), axis=-1)
        return np.asarray(along - offset - self.reach)[:, None]

    def jacobian(self, state: State) -> Floats:
        """(N, 1, P): the TCP's motion along the normal; of the pole, the tilt's arm at the TCP less the offset."""
        model, normal = self._model(state), self.normals(state)
        columns = np.einsum("nr,nrp->np", normal, model.jacobian(self.postures)[:, :3])[:, None]
        of_pole = by_pole(state.points[self.point], model.tcp(self.postures))
        return with_points(columns, of_pole[:, None], self.point, state, self.session)

    def errors(self, state: State) -> Floats:
        """Distance (N,) of the ball's surface from the plane, mm."""
        return np.abs(self.residual(state)[:, 0])

    def normals(self, state: State) -> Floats:
        """Each row's unit normal (N, 3), on the side that is touched."""
        return planes_of(state.points[self.point])[0]

    def place(self, model: RobotModel) -> Floats:
        """The pole (3,), mm, of the plane that the TCPs lie on."""
        tcps = model.tcp(self.postures)
        return plane_pole(tcps, self.reach, model.chain.frames(self.q)[..., :3, 3])

    def squared_misfits(self, tcps: Floats) -> Floats:
        """From each plane."""
        found = [_from_their_plane(tcps[:, self.point == index]) for index in np.unique(self.point)]
        return np.concatenate(found, axis=1)

    def proposed(self, state: State, reachable: Reachable) -> Self:
        """On the same planes in turn, between two existing touches."""
        tcps = self._model(state).tcp(self.postures) - self.residual(state) * self.normals(state)
        share = evenly(3, reachable.tried)
        rows = [np.flatnonzero(self.point == name) for name in _in_turn(self.point, reachable.tried)]
        first, second = (
            np.array([mine[int(part * len(mine))] for mine, part in zip(rows, share[:, column], strict=True)])
            for column in (0, 1)
        )
        goals = tcps[first] + share[:, 2:] * (tcps[second] - tcps[first])
        at, chosen = reachable.at(goals, self.normals(state)[first])
        there = replace(self.pick(first[chosen]), at=at, sigma=self.usual_sigma(len(at)))
        return replace(there, reach=there.reach + there.residual(state)[:, 0])

    def anywhere(self, state: State) -> Floats:
        """TCPs (N, 3) that touch each row's plane, up to `ACROSS_MM` from their places."""
        tcps, normal = self._model(state).tcp(self.postures), self.normals(state)
        beside = np.random.default_rng(len(self)).uniform(-ACROSS_MM, ACROSS_MM, tcps.shape)
        lift = np.sum(normal * beside, axis=1) + self.residual(state)[:, 0]
        return np.asarray(tcps + beside - lift[:, None] * normal)


def planes_of(poles: Floats) -> tuple[Floats, Floats]:
    """Unit normals (N, 3) and offsets (N,), mm, of the planes with these poles (N, 3), mm; n·x = d on the plane."""
    length = np.maximum(np.linalg.norm(poles, axis=-1), 1e-9)
    offset = 0.5 * (length - SCALE_MM**2 / length)
    return np.asarray(poles / length[..., None]), np.asarray(offset)


def pole_of(normal: Floats, offset: float) -> Floats:
    """The pole (3,), mm, of the plane with the unit `normal` (3,) at the `offset`, mm."""
    return np.asarray(SCALE_MM * np.exp(np.arcsinh(offset / SCALE_MM)) * normal)


def by_pole(poles: Floats, points: Floats) -> Floats:
    """Derivative (N, 3) by the pole of the height of `points` (N, 3), mm, above the planes with `poles` (N, 3), mm.

    Of n·x − d with n = p/|p| and d = (|p| − s²/|p|)/2: (x − (n·x) n)/|p| − ½ (1 + s²/|p|²) n.
    """
    length = np.maximum(np.linalg.norm(poles, axis=-1, keepdims=True), 1e-9)
    normal = poles / length
    across = points - np.sum(normal * points, axis=-1, keepdims=True) * normal
    return np.asarray(across / length - 0.5 * (1.0 + (SCALE_MM / length) ** 2) * normal)


def plane_pole(tcps: Floats, reach: Floats, frames: Floats) -> Floats:
    """Pole (3,), mm, of the plane at distances `reach` (N,), mm, from `tcps` (N, 3), mm: across the direction of least
    spread, its normal towards the part that carries the TCPs: the last of the robot's `frames` (N, K, 3), mm, that is
    not at the TCP.
    """
    away, arms = tcps - tcps.mean(axis=0), frames - tcps[:, None]
    carrying = np.flatnonzero(np.linalg.norm(arms, axis=-1).mean(axis=0) > CARRIED_MM)
    normal = np.linalg.eigh(away.T @ away)[1][:, 0]
    if carrying.size and arms[:, carrying[-1]].mean(axis=0) @ normal < 0.0:
        normal = -normal
    return pole_of(normal, float(np.median(tcps @ normal - reach)))


@final
@dataclass(frozen=True, eq=False)
class SpacingRows:
    """Certified distances between points: spheres of a plate, sockets. pairs (N, 2): indices of points; mm (N,);
    sigma (N, 1), mm.
    """

    pairs: Any
    mm: Floats
    sigma: Floats

    def __len__(self) -> int:
        return len(self.sigma)

    @property
    def quantities(self) -> tuple[str, ...]:
        """One distance, whose σ is the certificate's."""
        return ("certified",)

    def residual(self, state: State) -> Floats:
        """Distance of the points minus the certified one (N, 1), mm."""
        return np.asarray(np.linalg.norm(self._between(state), axis=-1) - self.mm)[:, None]

    def jacobian(self, state: State) -> Floats:
        """(N, 1, P): the unit vector between the points, in their columns."""
        between = self._between(state)
        unit = between / np.maximum(np.linalg.norm(between, axis=-1, keepdims=True), 1e-9)
        result, each = np.zeros((len(self), 1, state.width)), np.arange(len(self))
        points = result[:, 0, state.of_points].reshape(len(self), -1, 3)
        points[each, self.pairs[:, 0]], points[each, self.pairs[:, 1]] = unit, -unit
        result[:, 0, state.of_points] = points.reshape(len(self), -1)
        return result

    def errors(self, state: State) -> Floats:
        """Deviation from the certificate (N,), mm."""
        return np.abs(self.residual(state)[:, 0])

    def pick(self, which: Any) -> Self:
        """The rows at an index array or mask."""
        return replace(self, pairs=self.pairs[which], mm=self.mm[which], sigma=self.sigma[which])

    def noisier(self, factors: Floats) -> Self:
        """The same rows with their standard deviations times `factors` (1,)."""
        return replace(self, sigma=self.sigma * factors)

    def _between(self, state: State) -> Floats:
        return np.asarray(state.points[self.pairs[:, 0]] - state.points[self.pairs[:, 1]])
