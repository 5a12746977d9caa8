"""Touches on spheres: directions, wrist orientations, order and paths, so that only the tip touches anything.

Contact normals lie quasi-randomly (Sobol) on the reachable cap of each sphere, wrist orientations in a cone about them,
spun about the tool's own axis; a touch is kept only where its whole way is within joint limits and clear of spheres,
stems and plate.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Self, final

import numpy as np
from numpy.typing import NDArray

from cellctl.kinematics import JointMap, SerialChain, inverse, nearest_turn
from cellctl.kinematics.low_discrepancy import sobol
from cellctl.planning.ways import Body, Obstacles, Plate, Reach, Thickness, Ways

Array = NDArray[np.float64]

_NEAREST = 8
"""How many of the nearest touches are tried as the next one, before a return home."""


@final
@dataclass(frozen=True, slots=True)
class PlannedTouch:
    """One touch: joint readings in degrees.

    `origin`: where the last touch ended, or home; `approach`: from there to clear of the sphere; `start`, `end`: of the
    search; `search_mm`: the tip's way between them by the nominal model; `retreat`: back to `start`, to clear of the
    sphere, and home after the last one. `reference`: it repeats an earlier touch, to see what has changed since.
    `chosen`: it was taken by a `BestTouches`.
    """

    sphere: str
    origin: tuple[float, ...]
    approach: tuple[tuple[float, ...], ...]
    start: tuple[float, ...]
    end: tuple[float, ...]
    search_mm: float
    retreat: tuple[tuple[float, ...], ...]
    reference: bool = False
    chosen: bool = False


@final
@dataclass(frozen=True, slots=True, eq=False)
class Candidate:
    """A touch whose own ways are clear, not yet part of a tour; joint readings (n,), deg."""

    sphere: str
    clear: Array
    start: Array
    end: Array
    search_mm: float
    reference: bool = False
    chosen: bool = False

    @classmethod
    def of(cls, touch: PlannedTouch) -> Self:
        """A touch of another tour, to be fitted into this one."""
        start, clear = (np.array(q) for q in touch.retreat[:2])
        return cls(touch.sphere, clear, start, np.array(touch.end), touch.search_mm)


def ordered(candidates: Sequence[Candidate], ways: Ways, home: Array) -> list[Candidate]:
    """From home, always next the nearest that can be reached directly; the nearest of all where none can."""
    tour: list[Candidate] = []
    left, here = list(candidates), home
    while left:
        left.sort(key=lambda c: float(np.abs(c.clear - here).max()))
        near = next((i for i, c in enumerate(left[:_NEAREST]) if ways.clear(here, c.clear)), 0)
        tour.append(left.pop(near))
        here = tour[-1].clear
    return tour


BLOCK = 10
"""Touches of a block where there is no reference touch."""


def _in_blocks(
    candidates: Sequence[Candidate], size: int, ways: Ways, home: Array, rng: np.random.Generator
) -> list[Candidate]:
    """Blocks of `size` touches drawn at random, each in the order of `ordered`."""
    tour: list[Candidate] = []
    order = rng.permutation(len(candidates)).tolist()
    for first in range(0, len(order), size):
        here = tour[-1].clear if tour else home
        tour += ordered([candidates[at] for at in order[first : first + size]], ways, here)
    return tour


def with_references(tour: Sequence[Candidate], every: int, reference: Candidate) -> list[Candidate]:
    """`tour` with a return to `reference` after each `every` touches."""
    again = replace(reference, reference=True, chosen=False)
    parts = [list(tour[first : first + every]) for first in range(0, len(tour), every)]
    return [touch for part in parts for touch in ([*part, again] if len(part) == every else part)]


def linked(tour: Sequence[Candidate], ways: Ways, home: Array) -> list[PlannedTouch]:
    """`tour` with its ways: from one touch to the next directly where that is clear, over home where it is not."""
    planned: list[PlannedTouch] = []
    here = home
    for number, touch in enumerate(tour, 1):
        approach = [touch.clear] if ways.clear(here, touch.clear) else [home, touch.clear]
        retreat = [touch.start, touch.clear, *([home] if number == len(tour) else [])]
        planned.append(
            PlannedTouch(
                touch.sphere,
                _row(here),
                tuple(_row(q) for q in approach),
                _row(touch.start),
                _row(touch.end),
                touch.search_mm,
                tuple(_row(q) for q in retreat),
                touch.reference,
                touch.chosen,
            )
        )
        here = touch.clear
    return planned


def _row(readings: Array) -> tuple[float, ...]:
    return tuple(round(float(a), 4) for a in readings)


_BATCH, _BATCHES = 512, 16
"""Quasi-random samples per batch, and batches before a sphere counts as out of reach."""


@final
class OutOfReach(Exception):
    """Too few touches on a sphere can be reached; the text names the sphere."""


@final
@dataclass(frozen=True, slots=True)
class SphereTarget:
    """A sphere to touch: its rough place (base frame, mm), and its diameter plus the tip's."""

    name: str
    centre: tuple[float, float, float]
    contact_radius: float


@final
@dataclass(frozen=True, slots=True)
class TouchOptions:
    """How to touch; mm and degrees.

    `guard`: distance to the expected surface at which a search starts; `depth`: how far inside the expected surface it
    ends without contact; `cap`: largest angle of the contact normal from straight up; `tilt`: largest angle between
    the tool's shaft and the normal; `clear`: distance from the surface at which the tool turns; `clearance`: the least
    distance of the robot's surface, of this `thickness`, from anything on the way; `search_joints`: the longest search,
    as norm of the joint vector; `wrist_bend`: the least angle of the last joint but one (the wrist is singular at 0);
    `turn`: the most that a joint turns between guard distance and clear; `tried`: feasible touches for each one that is
    planned; of more than one, those with normals farthest apart are planned.
    """

    guard: float = 10.0
    depth: float = 8.0
    cap: float = 100.0
    tilt: float = 55.0
    clear: float = 110.0
    clearance: float = 15.0
    thickness: Thickness = field(default_factory=Thickness)
    search_joints: float = 4.5
    wrist_bend: float = 12.0
    turn: float = 60.0
    tried: int = 1


@final
@dataclass(frozen=True, slots=True)
class RobotPostures:
    """Joint readings A1…An of one robot in its cell, degrees.

    `home`: clear of everything, where a campaign begins and ends; `touch`: from which the inverse kinematics of touches
    sets out, A1 turned towards the sphere.
    """

    home: tuple[float, ...]
    touch: tuple[tuple[float, ...], ...]


@final
@dataclass(frozen=True)
class BestTouches:
    """Besides the touches of the plan, the best of `candidates[i]` more on sphere i.

    choose: from the sphere (M,) and the readings at the contact (M, n), deg, of all candidates, the indices of those
    that are touched.
    """

    candidates: tuple[int, ...]
    choose: Callable[[NDArray[np.int_], Array], NDArray[np.int_]]


def plan_touches(
    chain: SerialChain,
    joints: JointMap,
    reach: Reach,
    postures: RobotPostures,
    spheres: list[SphereTarget],
    counts: list[int],
    seed: int,
    options: TouchOptions | None = None,
    *,
    plate: Plate | None = None,
    reference_every: int = 0,
    reference: PlannedTouch | None = None,
    best: BestTouches | None = None,
) -> list[PlannedTouch]:
    """Plan `counts[i]` touches on `spheres[i]`, in an order whose ways are clear, beginning and ending at home.

    The first touch's approach begins at `postures.home`; the last one's retreat ends there. A sphere with a count of 0
    is only kept clear of; so are `plate` (else one 100 mm below the lowest centre) and the stems on it. After each
    `reference_every` touches (0: never) comes a return to `reference`, a touch of an earlier plan, or else to this
    plan's first. `best` adds those that it chooses, and all are then in blocks drawn at random, each a short tour: so a
    drift is not the error of a place. The same seed gives the same touches. Raises OutOfReach naming the sphere on
    which too few touches are reachable.
    """
    options = options or TouchOptions()
    around = spheres_of(spheres)
    body = Body(chain, joints, options.thickness)
    ways = Ways(body, reach, Obstacles(around, plate or Plate.assumed(around)), options.clearance)
    chosen: list[Candidate] = []
    more: list[tuple[int, Candidate]] = []
    for index, count in enumerate(counts):
        most = count * options.tried
        wanted = most + (best.candidates[index] if best else 0)
        found = (
            _candidates(chain, joints, ways, postures, spheres[index], index, wanted, seed, options) if wanted else []
        )
        found, more = found[:most], more + [(index, each) for each in found[most:]]
        if len(found) < count:
            raise OutOfReach(
                f"only {len(found)} of {count} touches on sphere {spheres[index].name} can be reached within the joint "
                f"limits and clear of spheres, stems and plate"
            )
        chosen += _farthest_apart(found, body, count) if most > count else found
    if best:
        share = options.guard / (options.guard + options.depth)
        contacts = np.array([each.start + share * (each.end - each.start) for _, each in more])
        taken = best.choose(np.array([index for index, _ in more]), contacts)
        chosen += [replace(more[at][1], chosen=True) for at in taken.tolist()]
    home = np.array(postures.home)
    if best:
        tour = _in_blocks(chosen, reference_every or BLOCK, ways, home, np.random.default_rng([seed, 26]))
    else:
        tour = ordered(chosen, ways, home)
    if reference_every:
        tour = with_references(tour, reference_every, Candidate.of(reference) if reference else tour[0])
    return linked(tour, ways, home)


def moved_touch(
    chain: SerialChain,
    joints: JointMap,
    reach: Reach,
    postures: RobotPostures,
    spheres: list[SphereTarget],
    touch: PlannedTouch,
    by: Array,
    *,
    plate: Plate | None = None,
) -> PlannedTouch | None:
    """`touch` of a sphere that appears moved `by` (3,), mm: from the end of its retreat, and back there.

    None where the moved ways are not clear, or the joints do not reach.
    """
    options, around = TouchOptions(), spheres_of(spheres)
    index = [sphere.name for sphere in spheres].index(touch.sphere)
    plate = plate or Plate.assumed(around)
    around[index, :3] += by
    ways = Ways(Body(chain, joints, options.thickness), reach, Obstacles(around, plate), options.clearance)
    readings = np.array([touch.start, touch.end, touch.retreat[1]])
    poses = chain.forward(joints.model(readings))
    poses[:, :3, 3] += by
    found = inverse(chain, poses, joints.model(readings))
    if not found.converged.all():
        return None
    moved = nearest_turn(joints.readings(found.q), readings, 180.0)
    candidate = feasible(ways, touch.sphere, index, moved, np.array(postures.home), options)
    here = touch.retreat[-1]
    if candidate is None or not ways.within_limits(moved).all() or not ways.clear(np.array(here), candidate.clear):
        return None
    start, clear = _row(candidate.start), _row(candidate.clear)
    return PlannedTouch(
        touch.sphere, here, (clear,), start, _row(candidate.end), candidate.search_mm, (start, clear, here)
    )


def contacts(
    chain: SerialChain,
    joints: JointMap,
    reach: Reach,
    postures: RobotPostures,
    sphere: SphereTarget,
    around: Obstacles,
    count: int,
    seed: int,
    options: TouchOptions | None = None,
) -> Array:
    """Joint readings (m ≤ count, n), deg, at the contact of touches on `sphere`, the first of those in `around`."""
    options = options or TouchOptions()
    ways = Ways(Body(chain, joints, options.thickness), reach, around, options.clearance)
    found = _candidates(chain, joints, ways, postures, sphere, 0, count, seed, options)
    share = options.guard / (options.guard + options.depth)
    return np.array([each.start + share * (each.end - each.start) for each in found]).reshape(-1, chain.n)


def spheres_of(targets: list[SphereTarget]) -> Array:
    """Centres and contact radii, shape (n, 4), mm."""
    return np.array([[*target.centre, target.contact_radius] for target in targets])


def _candidates(
    chain: SerialChain,
    joints: JointMap,
    ways: Ways,
    postures: RobotPostures,
    sphere: SphereTarget,
    index: int,
    count: int,
    seed: int,
    options: TouchOptions,
) -> list[Candidate]:
    """The first `count` feasible touches of the sphere's quasi-random sequence, or fewer where it runs out."""
    sampler = sobol(6, rng=np.random.default_rng([seed, index]))
    home = np.array(postures.home)
    found: list[Candidate] = []
    for _ in range(_BATCHES):
        samples = sampler.random(_BATCH)
        normals, rotations = _wishes(samples, chain, options)
        for readings in solved(chain, joints, ways, postures, sphere, normals, rotations, samples[:, 5], options):
            candidate = feasible(ways, sphere.name, index, readings, home, options)
            if candidate:
                found.append(candidate)
                if len(found) == count:
                    return found
    return found


def _farthest_apart(found: list[Candidate], body: Body, count: int) -> list[Candidate]:
    """The first of `found`, then always the one whose contact normal is farthest from those of all chosen ones."""
    searches = np.array([body.tip(np.array([each.end, each.start])) for each in found])
    normals = _unit(searches[:, 1] - searches[:, 0])
    cosines = normals @ normals.T
    chosen = [0]
    while len(chosen) < count:
        chosen.append(int(cosines[:, chosen].max(axis=1).argmin()))
    return [found[index] for index in chosen]


def _wishes(samples: Array, chain: SerialChain, options: TouchOptions) -> tuple[Array, Array]:
    """Contact normals (k, 3) and tool rotations (k, 3, 3) in the base frame from quasi-random `samples` (k, ≥ 5)."""
    height, heading, tilt, direction, spin = samples.T[:5]
    normal = on_sphere(1.0 - height * (1.0 - np.cos(np.radians(options.cap))), heading)
    away = on_sphere(1.0 - tilt * (1.0 - np.cos(np.radians(options.tilt))), direction)
    shaft_away = (frames_along(normal) @ away[..., None])[..., 0]
    return normal, tool_rotations(chain, shaft_away, spin)


def tool_rotations(chain: SerialChain, shaft_away: Array, spin: Array) -> Array:
    """TCP rotations (k, 3, 3), base frame, with the shaft from tip to flange along `shaft_away` (k, 3), turned about it
    by `spin` (k,) of a whole turn.
    """
    shaft_in_flange = frames_along(_unit(chain.tool_now[:3, 3])[None])
    flange = frames_along(-shaft_away) @ _about_z(spin) @ np.swapaxes(shaft_in_flange, -1, -2)
    return np.asarray(flange @ chain.tool_now[:3, :3])


def solved(
    chain: SerialChain,
    joints: JointMap,
    ways: Ways,
    postures: RobotPostures,
    sphere: SphereTarget,
    normals: Array,
    rotations: Array,
    choice: Array,
    options: TouchOptions,
) -> Array:
    """Joint readings (m, 3, n), deg, at guard distance, inside and clear of the sphere, where all three exist."""
    distances = sphere.contact_radius + np.array([options.guard, -options.depth, options.clear])
    poses = np.tile(np.eye(4), (len(normals), 3, 1, 1))
    poses[..., :3, :3] = rotations[:, None]
    poses[..., :3, 3] = np.array(sphere.centre) + distances[:, None] * normals[:, None]
    starts = np.array(postures.touch)[(choice * len(postures.touch)).astype(int)]
    towards = np.degrees(np.arctan2(sphere.centre[1], sphere.centre[0]))
    starts[:, 0] = joints.sign[0] * (towards - joints.offset[0])
    first = inverse(chain, poses[:, 0], joints.model(starts))
    poses, q = poses[first.converged], first.q[first.converged]
    found = inverse(chain, poses, np.repeat(q[:, None], 3, axis=1))
    readings = ways.wrapped(joints.readings(found.q[found.converged.all(axis=1)]))
    return readings[ways.within_limits(readings).all(axis=1)]


def feasible(
    ways: Ways, sphere: str, index: int, readings: Array, home: Array, options: TouchOptions
) -> Candidate | None:
    """The touch with `readings` (3, n), deg, at guard distance, inside and clear, if its ways are allowed."""
    at_guard, inside, clear = readings
    if (
        np.linalg.norm(inside - at_guard) > options.search_joints
        or np.abs(readings[:, -2]).min() < options.wrist_bend
        or np.abs(clear - at_guard).max() > options.turn
        or not ways.only_tip_touches(at_guard, inside, index)
        or not ways.clear(clear, at_guard, touched=index)
        or not ways.clear(home, clear)
    ):
        return None
    return Candidate(sphere, clear, at_guard, inside, ways.tip_path(at_guard, inside))


def _unit(vector: Array) -> Array:
    unit: Array = vector / np.linalg.norm(vector, axis=-1, keepdims=True)
    return unit


def on_sphere(cosine: Array, turn: Array) -> Array:
    """Unit vectors (k, 3) at polar angle arccos `cosine` and azimuth `turn` (of a whole turn)."""
    sine = np.sqrt(np.maximum(0.0, 1.0 - cosine * cosine))
    angle = 2.0 * np.pi * turn
    return np.stack([sine * np.cos(angle), sine * np.sin(angle), cosine], axis=-1)


def frames_along(z: Array) -> Array:
    """Rotations (k, 3, 3) whose third columns are the unit vectors `z` (k, 3)."""
    helper = np.eye(3)[np.abs(z).argmin(axis=-1)]
    x = _unit(np.cross(helper, z))
    return np.stack([x, np.cross(z, x), z], axis=-1)


def _about_z(turn: Array) -> Array:
    """Rotations (k, 3, 3) about z by `turn` (of a whole turn)."""
    c, s, nought = np.cos(2.0 * np.pi * turn), np.sin(2.0 * np.pi * turn), np.zeros_like(turn)
    one = np.ones_like(turn)
    return np.stack([c, -s, nought, s, c, nought, nought, nought, one], axis=-1).reshape(-1, 3, 3)
