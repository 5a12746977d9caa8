"""Where the spheres, the instrument and the nests of a cell should be: least predicted error of the best rows there."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import final

import numpy as np

from cellctl.calibration.prediction.predict import REGION_POINTS
from cellctl.files import Document, InputError, load_yaml
from cellctl.formats import RobotFile, artefact_of, measurements, postures_of
from cellctl.formats.artefact import Artefact, Distance
from cellctl.formats.cell_sections import floor_of, reflectors_of, station_of
from cellctl.formats.design_problem import DesignProblem, candidate_rows, design_problem
from cellctl.formats.measurements.columns import SIGMA_COLUMNS
from cellctl.kinematics import Floats
from cellctl.kinematics.low_discrepancy import evenly, spread_over
from cellctl.planning import OutOfReach, Plate, PoseOptions, Reach, RobotPostures, Sight, SphereTarget
from cellctl.planning.design import chosen_rows
from cellctl.planning.layouts import best_layout, error_by_nests
from cellctl.planning.measuring_poses import MeasuringArm, measuring_postures
from cellctl.planning.touches import contacts
from cellctl.planning.ways import Obstacles

ROOM_MM = 300.0
"""Spheres may be so far outside the box of today's places."""

TOUCHES_EACH, LEAST_EACH = 60, 24
"""Touches on each place among which the best are chosen; with fewer than the least one the place is out of reach."""

_APART_MM = 200.0
"""Least distance of two centres: the tool passes between."""

_ABOVE_PLATE_MM = 60.0
"""Least height of a sphere's underside above the plate."""

_POSES, _NEAREST_MM, _FARTHEST_MM, _BEYOND_REACH_MM = 200, 1600.0, 8000.0, 300.0
"""Poses among which the best are chosen; range of the instrument; how far instrument and nests stay out of reach."""

_HEIGHTS_MM = (600.0, 2000.0)
"""Of instrument and nests above the floor, or above the robot's base where no floor is stated: a tripod's."""

_SIGMA_MM, _SIGMA_PER_MM = 0.0075, 3e-6
"""1 σ of a laser tracker on each axis, and for each mm of its distance (half of what a Leica AT960's data sheet allows:
15 µm + 6 µm/m)."""

_MARGIN_DEG = 3.0


@final
@dataclass(frozen=True)
class Moved:
    """A thing and its place (3,), mm, today and planned, in the robot's base frame."""

    name: str
    today: list[float]
    planned: list[float]

    @property
    def moved(self) -> bool:
        """Whether it has another place than today."""
        return self.today != self.planned


@final
@dataclass(frozen=True)
class Layout:
    """What is moved; predicted error, mm, 1 σ, 3-D, RMS of the best rows today and as planned. tried: possible places;
    lines: of the cell file. today_mm is None where today's place cannot be used.
    """

    what: str
    moved: list[Moved]
    today_mm: float | None
    planned_mm: float
    tried: int
    lines: list[str]


def layouts(cell: Path, robot: RobotFile, rows: int, places: int, seed: int) -> list[Layout]:
    """The best layouts of what the cell has: spheres, instrument, nests. rows: of the later fit; places: that are tried
    for each. Raises InputError for a cell without any, or where nothing is in reach.
    """
    document = load_yaml(cell)
    data = document.data if isinstance(document.data, dict) else {}
    found: list[Layout] = []
    if "artefact" in data:
        found.append(_Spheres.of(document, robot, rows, places, seed).layout())
    if "station" in data and "reflectors" in data:
        found += _of_instrument(document, robot, rows, places, seed)
    if not found:
        cure = "give a cell file with artefact:, or with station: and reflectors:"
        raise InputError(document.problem((), "has nothing to be placed", cure))
    return found


@final
@dataclass(frozen=True, eq=False)
class _Spheres:
    """Possible places (M, 3), today's first, with the touches that each has; `fixed` spheres stay."""

    document: Document
    robot: RobotFile
    artefact: Artefact
    names: list[str]
    places: Floats
    touches: list[Floats]
    rows: int
    seed: int

    @classmethod
    def of(cls, document: Document, robot: RobotFile, rows: int, places: int, seed: int) -> _Spheres:
        artefact = artefact_of(document, ("artefact",))
        names = [each.id for each in artefact.spheres]
        certified = {name for distance in artefact.distances for name in distance.between}
        names = [name for name in names if name in certified] or names
        if not names:
            raise InputError(document.problem(("artefact",), "has no sphere to be placed"))
        today = np.array([each.centre for each in artefact.spheres if each.id in names], float)
        low, high = today.min(axis=0) - ROOM_MM, today.max(axis=0) + ROOM_MM
        radius = max(each.diameter for each in artefact.spheres) / 2.0
        if artefact.plate:
            low[2] = artefact.plate.z + radius + _ABOVE_PLATE_MM
        tried = np.round(low + evenly(3, places) * (high - low))
        candidates = np.concatenate([today, tried])
        one = cls(document, robot, artefact, names, candidates, [], rows, seed)
        return replace(one, touches=[one.contacts(centre, one.fixed) for centre in candidates])

    @property
    def fixed(self) -> list[Floats]:
        """Centres (3,) of the spheres that stay, mm."""
        return [np.array(each.centre, float) for each in self.artefact.spheres if each.id not in self.names]

    def together(self, layout: tuple[int, ...]) -> _Spheres:
        """With the touches at these places that are clear of the spheres at the others."""
        touches = list(self.touches)
        for place in layout:
            others = [self.places[other] for other in layout if other != place]
            touches[place] = self.contacts(self.places[place], [*self.fixed, *others])
        return replace(self, touches=touches)

    def layout(self) -> Layout:
        """The best places of which the touches are also clear of the other spheres there."""
        start, refused = tuple(range(len(self.names))), set[tuple[int, ...]]()
        while True:
            best, planned = best_layout(
                start, len(self.places), lambda one: np.inf if tuple(sorted(one)) in refused else self.error(one)
            )
            if not np.isfinite(planned) or np.isfinite(planned := self.together(best).error(best)):
                break
            refused.add(tuple(sorted(best)))
        if not np.isfinite(planned):
            cure = "move the spheres nearer to the robot, or allow more --places"
            raise InputError(self.document.problem(("artefact",), "no layout is in the robot's reach", cure))
        today = self.together(start).error(start)
        at = dict(zip(self.names, best, strict=True))
        moved = [
            Moved(name, self.places[old].tolist(), self.places[new].tolist())
            for old, (name, new) in enumerate(at.items())
        ]
        usable = sum(len(each) >= LEAST_EACH for each in self.touches)
        return Layout("spheres", moved, today if np.isfinite(today) else None, planned, usable, self._lines(best))

    def error(self, layout: tuple[int, ...]) -> float:
        """Predicted by the best touches of a layout, mm; infinite where it is not possible."""
        centres = self.places[list(layout)]
        all_of = np.array([*centres, *self.fixed])
        gaps = np.linalg.norm(all_of[:, None] - all_of[None], axis=2) + 1e9 * np.eye(len(all_of))
        if gaps.min() < _APART_MM or min(len(self.touches[place]) for place in layout) < LEAST_EACH:
            return np.inf
        readings = np.concatenate([self.touches[place] for place in layout])
        spheres = [name for name, place in zip(self.names, layout, strict=True) for _ in self.touches[place]]
        task = measurements(
            self.robot, candidate_rows(readings, {"sphere": spheres}), model="geometry", artefact=self._moved(layout)
        ).task
        return _best_error(design_problem(task), self.robot, self._asked(), self.rows)

    def _asked(self) -> Floats:
        """Joint readings (2, n), deg: the least and greatest at any place, so that all layouts are for one task."""
        everywhere = np.concatenate(self.touches)
        return np.array([everywhere.min(axis=0), everywhere.max(axis=0)])

    def _moved(self, layout: tuple[int, ...]) -> Artefact:
        """The artefact with the spheres at a layout's places, certified distances between them as there."""
        at = {name: self.places[place].tolist() for name, place in zip(self.names, layout, strict=True)}
        spheres = [each.model_copy(update={"centre": at.get(each.id, each.centre)}) for each in self.artefact.spheres]
        place = {each.id: np.array(each.centre) for each in spheres}

        def distance(one: Distance) -> Distance:
            a, b = one.between
            apart = float(np.linalg.norm(place[a] - place[b])) if a in place and b in place else one.mm
            return one.model_copy(update={"mm": apart})

        return self.artefact.model_copy(
            update={"spheres": spheres, "distances": [distance(each) for each in self.artefact.distances]}
        )

    def contacts(self, centre: Floats, others: list[Floats]) -> Floats:
        """Readings (m, n), deg, of touches on a sphere there, clear of those at `others`."""
        robot, artefact = self.robot, self.artefact
        diameter = max(each.diameter for each in artefact.spheres if each.id in self.names)
        radius = diameter / 2.0 + artefact.tip_radius
        target = SphereTarget("planned", (centre[0], centre[1], centre[2]), radius)
        around = np.array([[*each, radius] for each in (centre, *others)])
        plate = Plate(artefact.plate.z, artefact.plate.stem_radius) if artefact.plate else Plate.assumed(around)
        postures = postures_of(self.document, robot, "touch")
        low, high = robot.limits().T.tolist()
        return contacts(
            robot.chain(),
            robot.joint_map(),
            Reach(tuple(low), tuple(high)),
            RobotPostures(tuple(postures.home), tuple(map(tuple, postures.touch))),
            target,
            Obstacles(around, plate),
            TOUCHES_EACH,
            self.seed,
        )

    def _lines(self, layout: tuple[int, ...]) -> list[str]:
        moved = self._moved(layout)
        lines = ["artefact:", "  spheres:"]
        lines += [f"    - {{id: {s.id}, diameter: {s.diameter:g}, centre: {_triple(s.centre)}}}" for s in moved.spheres]
        if moved.distances:
            lines += ["  distances:              # nominal: have them certified at the new places"]
        lines += [
            f"    - {{between: [{', '.join(d.between)}], mm: {d.mm:.3f}, sigma: {d.sigma:g}}}" for d in moved.distances
        ]
        return lines


def _of_instrument(document: Document, robot: RobotFile, rows: int, places: int, seed: int) -> list[Layout]:
    """The instrument's place, and those of the nests that no certificate holds."""
    station, given, floor = station_of(document), reflectors_of(document), floor_of(document)
    home = np.array(postures_of(document, robot, "turn").home)
    ground = floor.z if floor else 0.0
    options = PoseOptions(side=(1,) * robot.n, floor=ground, clearance=floor.clearance_mm if floor else 100.0)
    low, high = np.clip(robot.limits(), -180.0, 180.0).T.tolist()
    reach = Reach(tuple(low), tuple(high), margin=_MARGIN_DEG)
    ring = _out_of_reach(robot, places, ground)
    tried = np.concatenate([np.array([station.xyz], float), ring])
    chain, joints, one = robot.chain(), robot.joint_map(), given.on_flange[0]

    def postures(place: Floats) -> Floats | None:
        sight = Sight(
            place, np.array([one.xyz]), np.array([one.facing]), given.acceptance_deg - _MARGIN_DEG, _NEAREST_MM
        )
        arm = MeasuringArm(chain.with_base(np.eye(4)), joints, sight, home, options)
        try:
            return measuring_postures(arm, reach, max(_POSES, 2 * rows), seed)
        except OutOfReach:
            return None

    seen = {at: each for at, place in enumerate(tried) if (each := postures(place)) is not None}
    if not seen:
        cure = "turn the reflector on the flange, or allow more --places"
        raise InputError(document.problem(("station", "xyz"), "no place of the instrument sees enough poses", cure))
    everywhere = np.concatenate(list(seen.values()))
    asked = np.array([everywhere.min(axis=0), everywhere.max(axis=0)])
    errors = {at: _of_positions(robot, one.xyz, each, tried[at], asked, rows) for at, each in seen.items()}
    best = min(errors, key=lambda at: errors[at])
    place = tried[best]
    lines = ["station:", f"  xyz: {_triple(place)}"]
    moved = [Moved("station", list(station.xyz), place.tolist())]
    found = [Layout("instrument", moved, errors.get(0), errors[best], len(seen), lines)]
    held = {name for distance in station.distances for name in distance.between}
    free = [nest for nest in station.nests if nest.id not in held]
    if len(free) >= 1 and len(station.nests) >= 3:
        found.append(_nests(document, robot, place, ring, everywhere))
    return found


def _nests(document: Document, robot: RobotFile, place: Floats, ring: Floats, poses: Floats) -> Layout:
    """The nests that no certificate holds, chosen among places in the instrument's range; the others stay."""
    station = station_of(document)
    held = {name for distance in station.distances for name in distance.between}
    stay = np.array([nest.xyz for nest in station.nests if nest.id in held], float).reshape(-1, 3)
    free = [nest for nest in station.nests if nest.id not in held]
    today = np.array([nest.xyz for nest in free], float)
    far = np.linalg.norm(ring - place, axis=1)
    ring = ring[(far > _NEAREST_MM) & (far < _FARTHEST_MM)]
    chain, joints = robot.chain(), robot.joint_map()
    asked = chain.forward(joints.model(poses[:: max(1, len(poses) // 64)]))[:, :3, 3]

    def error(layout: tuple[int, ...]) -> float:
        nests = np.concatenate([stay, everywhere[list(layout)]])
        far = np.linalg.norm(nests - place, axis=1)
        if np.linalg.norm(nests[:, None] - nests[None], axis=2)[~np.eye(len(nests), dtype=bool)].min() < ROOM_MM:
            return np.inf
        sigma = _SIGMA_MM + _SIGMA_PER_MM * far
        return error_by_nests(nests, sigma, asked)

    everywhere = np.concatenate([today, ring])
    start = tuple(range(len(free)))
    best, planned = best_layout(start, len(everywhere), error)
    moved = [Moved(nest.id, list(nest.xyz), everywhere[at].tolist()) for nest, at in zip(free, best, strict=True)]
    at = {one.name: one.planned for one in moved}
    lines = ["station:", "  nests:"]
    lines += [f"    - {{id: {nest.id}, xyz: {_triple(at.get(nest.id, nest.xyz))}}}" for nest in station.nests]
    return Layout("nests", moved, error(start), planned, len(ring), lines)


def _out_of_reach(robot: RobotFile, places: int, ground: float) -> Floats:
    """Places (M, 3), mm, about the robot at a tripod's heights, that nothing on the robot reaches."""
    chain = robot.chain()
    low, high = robot.limits().T
    q = robot.joint_map().model(spread_over(low, high, 2048, scramble=False))
    base, points = chain.base_now[:2, 3], chain.forward(q)[:, :3, 3]
    inner = float(np.linalg.norm(points[:, :2] - base, axis=1).max()) + _BEYOND_REACH_MM
    share = evenly(3, places)
    radius, turn = inner + share[:, 0] * inner, 2.0 * np.pi * share[:, 1]
    height = ground + _HEIGHTS_MM[0] + share[:, 2] * (_HEIGHTS_MM[1] - _HEIGHTS_MM[0])
    return np.round(np.stack([base[0] + radius * np.cos(turn), base[1] + radius * np.sin(turn), height], axis=1))


def _of_positions(
    robot: RobotFile, reflector: list[float], readings: Floats, place: Floats, asked: Floats, rows: int
) -> float:
    """Predicted error of the best `rows` of postures measured from `place`, mm."""
    tool = robot.tool.model_copy(update={"xyz": tuple(reflector)})
    seen = robot.model_copy(update={"tool": tool})
    points = seen.chain().forward(seen.joint_map().model(readings))[:, :3, 3]
    instrument = _SIGMA_MM + _SIGMA_PER_MM * np.linalg.norm(points - place, axis=1)
    sigma = np.hypot(instrument, robot.repeatability / np.sqrt(3.0)).tolist()
    columns = dict(zip("XYZ", points.T.tolist(), strict=True)) | dict.fromkeys(SIGMA_COLUMNS, sigma)
    task = measurements(seen, candidate_rows(readings, columns), model="geometry").task
    return _best_error(design_problem(task), seen, asked, rows)


def _best_error(problem: DesignProblem, robot: RobotFile, asked: Floats, rows: int) -> float:
    low, high = robot.joint_map().model(asked)
    places = problem.places(spread_over(np.minimum(low, high), np.maximum(low, high), REGION_POINTS, scramble=False))
    return chosen_rows(problem.covariance, problem.candidates, places, rows).sigma_mm


def _triple(values: object) -> str:
    return "[" + ", ".join(f"{float(value):g}" for value in values) + "]"  # type: ignore[attr-defined]
