"""Postures at which an instrument measures reflectors on the robot: quasi-random, visible, above the floor.

Sobol samples in joint space; a sample is kept where every reflector faces the station, in range, with nothing of the
arm in the beam, and the whole arm is above the floor. Each posture is approached with every joint from a stated side;
a share of the postures of the fit is visited once more from the other side, which shows backlash.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TypeAlias, final

import numpy as np
from numpy.typing import NDArray

from cellctl.kinematics import JointMap, SerialChain
from cellctl.kinematics.low_discrepancy import sobol
from cellctl.planning.touches import OutOfReach
from cellctl.planning.ways import Body, Obstacles, Reach, Thickness, between_lines

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
_Check: TypeAlias = Callable[[Array], Mask]

_BATCH, _BATCHES = 2048, 128
_FROM_SPHERES_MM = 40.0
"""Least distance of arm, tool and reflectors from spheres and their stems, and of the beam."""

_STEP_DEG = 4.0
"""Step in which ways are checked against the floor: joint degrees of the axis that moves most."""


@final
@dataclass(frozen=True, slots=True, eq=False)
class Sight:
    """What the station must see, mm and degrees. station (3,): its place in the base frame.

    reflectors, facing (M, 3): centres and directions in the flange frame; all M are to be visible. acceptance: half
    angle within which they reflect, with the margin for errors of robot and station already taken off. nearest,
    farthest: range of the instrument. nests (K, 3): other reflectors, which the search for one on the robot must not
    find; search: half width of its window at the reflector.
    """

    station: Array
    reflectors: Array
    facing: Array
    acceptance: float = 27.0
    nearest: float = 800.0
    farthest: float = 40_000.0
    nests: Array = field(default_factory=lambda: np.zeros((0, 3)))
    search: float = 0.0


@final
@dataclass(frozen=True, slots=True)
class Counts:
    """How many postures. fit: for the identification; held_out: all that judge; late: those of them in a block at the
    end, the others being interleaved with the fit. from_both: share of the fit's postures visited from both sides.
    """

    fit: int = 80
    held_out: int = 50
    late: int = 25
    from_both: float = 0.15


@final
@dataclass(frozen=True, slots=True)
class PoseOptions:
    """side: of each joint, 1: the reading grows as it arrives, −1: it falls. step: degrees that each joint moves in the
    approach. floor: height in the base frame, mm, or None; clearance: from it; apart: between wrist and the robot's own
    column. arm: radius of column and upper arm, mm. around: spheres to keep clear of, None if there are none.
    amplified: largest turn of a joint per turn of the tool, its TCP at rest; no correction can be commanded nearer to a
    singularity.
    """

    side: tuple[int, ...] = (1, 1, 1, 1, 1, 1)
    step: float = 3.0
    floor: float | None = None
    clearance: float = 100.0
    arm: float = 130.0
    apart: float = 120.0
    amplified: float = 4.0
    thickness: Thickness = field(default_factory=Thickness)
    around: Obstacles | None = None


@final
@dataclass(frozen=True, slots=True, eq=False)
class MeasuringPoses:
    """N visits in order; joint readings in degrees.

    readings, approach (N, n): the posture, and where its approach begins. side (N, n): 1 or −1. over_home (N,): the
    way to the approach goes over the home posture, because the direct one comes too near the floor or the robot itself.
    held_out, late (N,). again (N,): the visit of the same posture from the other side, −1 for none.
    """

    readings: Array
    approach: Array
    side: NDArray[np.int_]
    over_home: Mask
    held_out: Mask
    late: Mask
    again: NDArray[np.int_]

    def __len__(self) -> int:
        return len(self.readings)


def plan_measuring_poses(
    chain: SerialChain,
    joints: JointMap,
    reach: Reach,
    sight: Sight,
    counts: Counts,
    home: Array,
    seed: int,
    options: PoseOptions | None = None,
) -> MeasuringPoses:
    """Plan the visits of a campaign; begin and end are at `home` (n,), deg. The same seed gives the same plan.

    Held-out postures lie within the joints of the fit: outside, a model extrapolates, and no table may go there.
    Raises OutOfReach where too few postures are found; the text says what rejected most samples. Raises ValueError
    for sides that are not ±1 for each joint, or a late block larger than the held-out postures.
    """
    arm = _measuring_arm(chain, joints, sight, counts, home, options)
    rng = np.random.default_rng([seed, 11])
    found = _extremes_first(_postures(arm, reach, counts.fit + counts.held_out, rng))
    return _in_order(arm, found, counts, rng)


def measuring_postures(arm: MeasuringArm, reach: Reach, count: int, seed: int) -> Array:
    """Postures (count, n), deg, that can be measured, those at the ends of the joints first. Raises OutOfReach."""
    return _extremes_first(_postures(arm, reach, count, np.random.default_rng([seed, 11])))


def plan_given_poses(
    chain: SerialChain,
    joints: JointMap,
    sight: Sight,
    counts: Counts,
    home: Array,
    seed: int,
    postures: Array,
    options: PoseOptions | None = None,
) -> MeasuringPoses:
    """The visits of a campaign to given postures (fit + held_out, n), deg, those of the fit first.

    They are not checked: see `unmeasurable`. Raises ValueError as `plan_measuring_poses`, and for another number of
    postures.
    """
    arm = _measuring_arm(chain, joints, sight, counts, home, options)
    if len(postures) != counts.fit + counts.held_out:
        raise ValueError(f"{len(postures)} postures for {counts.fit} of the fit and {counts.held_out} held out")
    return _in_order(arm, np.round(postures, 4), counts, np.random.default_rng([seed, 11]))


def unmeasurable(arm: MeasuringArm, reach: Reach, postures: Array) -> dict[int, str]:
    """The places (from 0) of those of the postures (N, n), deg, that cannot be measured, each with its reason."""
    margin = reach.margin + arm.options.step
    low, high = np.array(reach.minimum) + margin, np.array(reach.maximum) - margin
    within = ((postures >= low) & (postures <= high)).all(axis=1)
    refused = dict.fromkeys(np.flatnonzero(~within).tolist(), "a joint is at its limit, or its approach is")
    left = np.flatnonzero(within)
    for reason, passes in arm.checks():
        passed = passes(postures[left])
        refused |= dict.fromkeys(left[~passed].tolist(), reason)
        left = left[passed]
    return dict(sorted(refused.items()))


def _measuring_arm(
    chain: SerialChain, joints: JointMap, sight: Sight, counts: Counts, home: Array, options: PoseOptions | None
) -> MeasuringArm:
    options = options or PoseOptions()
    if len(options.side) != chain.n or set(options.side) - {1, -1} or counts.late > counts.held_out:
        raise ValueError(f"a side of 1 or -1 for each of {chain.n} joints, and not more late than held-out postures")
    return MeasuringArm(chain.with_base(np.eye(4)), joints, sight, home, options)


def _in_order(arm: MeasuringArm, found: Array, counts: Counts, rng: np.random.Generator) -> MeasuringPoses:
    """The visits to the postures `found`, those of the fit first."""
    visits = _visits(counts, rng)
    side = np.array([visit.sign for visit in visits])[:, None] * np.array(arm.options.side)
    readings = found[[visit.posture for visit in visits]]
    approach = readings - arm.options.step * side
    again = [
        next((k for k, other in enumerate(visits) if other.posture == visit.posture and k != place), -1)
        for place, visit in enumerate(visits)
    ]
    return MeasuringPoses(
        readings,
        approach,
        side,
        ~arm.clear_way(np.array([arm.home, *readings[:-1]]), approach),
        np.array([visit.held_out for visit in visits]),
        np.array([visit.late for visit in visits]),
        np.array(again),
    )


@final
@dataclass(frozen=True, slots=True)
class _Visit:
    posture: int
    sign: int
    held_out: bool
    late: bool


def _visits(counts: Counts, rng: np.random.Generator) -> list[_Visit]:
    """Fit and interleaved held-out postures in random order, then the late block."""
    both = rng.choice(counts.fit, round(counts.from_both * counts.fit), replace=False)
    main = [_Visit(posture, 1, False, False) for posture in range(counts.fit)]
    main += [_Visit(int(posture), -1, False, False) for posture in both]
    late_from = counts.fit + counts.held_out - counts.late
    main += [_Visit(posture, 1, True, False) for posture in range(counts.fit, late_from)]
    late = [_Visit(posture, 1, True, True) for posture in range(late_from, counts.fit + counts.held_out)]
    return [*(main[place] for place in rng.permutation(len(main))), *late]


def _postures(arm: MeasuringArm, reach: Reach, count: int, rng: np.random.Generator) -> Array:
    """The first `count` usable Sobol samples (count, n), deg."""
    margin = reach.margin + arm.options.step
    low, high = np.array(reach.minimum) + margin, np.array(reach.maximum) - margin
    sampler = sobol(len(low), rng=rng)
    found: list[Array] = []
    rejected: dict[str, int] = {}
    for _ in range(_BATCHES):
        readings = low + sampler.random(_BATCH) * (high - low)
        for reason, passes in arm.checks():
            passed = passes(readings)
            rejected[reason] = rejected.get(reason, 0) + int(np.count_nonzero(~passed))
            readings = readings[passed]
        found.extend(readings)
        if len(found) >= count:
            return np.round(found[:count], 4)
    most = max(rejected, key=lambda reason: rejected[reason])
    raise OutOfReach(
        f"only {len(found)} of {count} measuring poses found among {_BATCH * _BATCHES} samples; most were rejected "
        f"because {most}: move the station, widen the joint limits, or change the reflector"
    )


def _extremes_first(postures: Array) -> Array:
    """The postures (N, n), those with the least or greatest reading of a joint before the others."""
    extreme = np.unique(np.concatenate([postures.argmin(axis=0), postures.argmax(axis=0)]))
    return np.concatenate([postures[extreme], np.delete(postures, extreme, axis=0)])


@final
class MeasuringArm:
    """The robot by its nominal model: where its links, its reflectors and the beam to the station are."""

    def __init__(self, chain: SerialChain, joints: JointMap, sight: Sight, home: Array, options: PoseOptions) -> None:
        self._chain, self._joints, self._sight, self.home, self.options = chain, joints, sight, home, options
        self._body = Body(chain, joints, options.thickness)
        self._facing = sight.facing / np.linalg.norm(sight.facing, axis=-1, keepdims=True)
        thin = max(1, chain.n - 3)
        self._radii = np.array([options.arm] * thin + [options.thickness.wrist] * (chain.n - thin))

    def usable(self, readings: Array) -> Mask:
        """Whether (k,) the reflectors can be measured at readings (k, n), deg, clear of everything, also on the way
        from home."""
        return np.asarray(np.all([passes(readings) for _, passes in self.checks()], axis=0))

    def checks(self) -> list[tuple[str, _Check]]:
        """Reasons for rejection and what passes, the cheapest and most selective first."""
        return [
            ("no reflector faces the station in range", self.faces_station),
            ("a monument's nest is in the search window of the reflector", self.found_alone),
            ("the arm would come too near the floor", self.above_floor),
            ("the wrist would come too near the robot's own column", self.clear_of_itself),
            ("the arm would come too near a sphere", self.clear_of_spheres),
            ("the posture is near a singularity", self.away_from_singularities),
            ("the arm or a sphere is in the beam", self.free_beam),
            ("the way from home comes too near the floor, a sphere or the robot's own column", self.clear_from_home),
        ]

    def faces_station(self, readings: Array) -> Mask:
        """Whether (k,) every reflector faces the station within its acceptance angle and is in range."""
        places, facing = self._reflectors(readings)
        beam = self._sight.station - places
        distance = np.linalg.norm(beam, axis=-1)
        cosine = np.einsum("kmi,kmi->km", beam, facing) / distance
        inside = (distance > self._sight.nearest) & (distance < self._sight.farthest)
        return np.asarray((inside & (cosine > np.cos(np.radians(self._sight.acceptance)))).all(axis=1))

    def found_alone(self, readings: Array) -> Mask:
        """Whether (k,) no nest lies in the square window of the search, wherever within its half width both are."""
        places, _ = self._reflectors(readings)
        beams, nests = places - self._sight.station, self._sight.nests - self._sight.station
        ranges, far = np.linalg.norm(beams, axis=-1), np.linalg.norm(nests, axis=-1)
        cosine = np.einsum("kmi,ni->kmn", beams, nests) / (ranges[..., None] * far)
        needed = np.sqrt(2.0) * self._sight.search / ranges[..., None] + self._sight.search / far
        return np.asarray((np.arccos(np.clip(cosine, -1.0, 1.0)) > needed).all(axis=(1, 2)))

    def above_floor(self, readings: Array) -> Mask:
        """Whether (k,) links from the elbow on, TCP and reflectors keep the clearance from the floor."""
        return np.asarray(self._lowest(readings) > self._height_needed)

    def clear_of_itself(self, readings: Array) -> Mask:
        """Whether (k,) wrist and TCP keep apart from column and shoulder."""
        links, tcp = self._links(readings)
        ends = [(links[:, -3], links[:, -1]), (links[:, -1], tcp)]
        foot, shoulder = links[:, 0], links[:, 1]
        needed = self.options.arm + self.options.apart
        gaps = [between_lines(start, end, foot, shoulder) for start, end in ends]
        return np.asarray(np.min(gaps, axis=0) > needed)

    def clear_of_spheres(self, readings: Array) -> Mask:
        """Whether (k,) forearm, wrist, tool and reflectors keep their distance from the spheres and their stems."""
        around = self.options.around
        if around is None:
            return np.ones(len(readings), bool)
        at, thick, (places, _) = self._body.at(readings), self.options.thickness, self._reflectors(readings)
        limbs = [
            (at.elbow, at.wrist, thick.wrist),
            (at.wrist, at.flange, thick.wrist),
            (at.flange, at.tip, thick.shaft),
        ]
        limbs += [(at.flange, places[:, number], thick.shaft) for number in range(places.shape[1])]
        gaps = [around.gaps(start, end).min(axis=0) - radius for start, end, radius in limbs]
        return np.asarray(np.min(gaps, axis=0) > _FROM_SPHERES_MM)

    def _clear_beam(self, places: Array) -> Mask:
        """Whether (k,) the beams to the reflectors at `places` (k, M, 3) pass the spheres and their stems."""
        around = self.options.around
        if around is None:
            return np.ones(len(places), bool)
        station = np.broadcast_to(self._sight.station, places[:, 0].shape)
        gaps = [around.gaps(places[:, number], station).min(axis=0) for number in range(places.shape[1])]
        return np.asarray(np.min(gaps, axis=0) > _FROM_SPHERES_MM)

    def away_from_singularities(self, readings: Array) -> Mask:
        """Whether (k,) no joint turns more than `amplified` times as far as the tool."""
        inverse = np.linalg.pinv(self._chain.tool_jacobian(self._joints.model(readings)))
        return np.asarray(np.linalg.norm(inverse[:, :, 3:], axis=2).max(axis=1) < self.options.amplified)

    def free_beam(self, readings: Array) -> Mask:
        """Whether (k,) every beam passes all links, or comes nowhere nearer to a link than the reflector itself is.

        A reflector near the forearm is not excused: the plate turns with the flange, and may dip into the forearm.
        """
        places, _ = self._reflectors(readings)
        links, _ = self._links(readings)
        start, end = links[:, None, :-1], links[:, None, 1:]
        reflector = places[:, :, None]
        beam = between_lines(reflector, np.broadcast_to(self._sight.station, reflector.shape), start, end)
        own = between_lines(reflector, reflector, start, end)
        needed = np.minimum(self._radii, own - 1.0)
        forearm = slice(max(1, self._chain.n - 3), self._chain.n - 2)
        needed[..., forearm] = self._radii[forearm]
        past_links = (beam >= needed).all(axis=(1, 2))
        return np.asarray(past_links & self._clear_beam(places))

    def clear_from_home(self, readings: Array) -> Mask:
        """Whether (k,) the ways from home to the posture and to where its approaches begin, both sides, are clear."""
        begin, step = np.tile(self.home, (len(readings), 1)), self.options.step * np.array(self.options.side)
        return np.asarray(np.all([self.clear_way(begin, readings + sign * step) for sign in (-1, 0, 1)], axis=0))

    def clear_way(self, start: Array, end: Array) -> Mask:
        """Whether (k,) the straight joint-space ways from `start` to `end` (k, n) keep clear of everything."""
        longest = np.abs(end - start).max(initial=0.0)
        shares = np.linspace(0.0, 1.0, int(np.ceil(longest / _STEP_DEG)) + 2)[:, None, None]
        ways = (start + shares * (end - start)).reshape(-1, start.shape[1])
        clear = self.above_floor(ways) & self.clear_of_itself(ways) & self.clear_of_spheres(ways)
        return np.asarray(clear.reshape(len(shares), len(start)).all(axis=0))

    @property
    def _height_needed(self) -> float:
        floor = self.options.floor
        return -np.inf if floor is None else floor + self.options.clearance

    def _lowest(self, readings: Array) -> Array:
        links, tcp = self._links(readings)
        places, _ = self._reflectors(readings)
        arm = links[:, 2:, 2].min(axis=1) - self.options.thickness.wrist
        return np.asarray(np.minimum(np.minimum(arm, tcp[:, 2]), places[..., 2].min(axis=1)))

    def _links(self, readings: Array) -> tuple[Array, Array]:
        """Joints' frames and flange (k, n + 1, 3), and the TCP (k, 3), mm."""
        q = self._joints.model(readings)
        return self._chain.frames(q)[..., :3, 3], self._chain.forward(q)[:, :3, 3]

    def _reflectors(self, readings: Array) -> tuple[Array, Array]:
        """Centres and facing directions (k, M, 3) in the base frame."""
        flange = self._chain.forward_flange(self._joints.model(readings))
        turn = np.swapaxes(flange[:, :3, :3], 1, 2)
        return self._sight.reflectors @ turn + flange[:, None, :3, 3], self._facing @ turn
