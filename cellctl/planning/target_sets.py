"""Targets for a calibration with any instrument, drawn by one of several methods, within limits, visible and clear.

A method draws points of a region (`workspaces`), finds their joint readings, rejects what cannot be measured, and
chooses. The same seed gives the same targets.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal, TypeAlias, final, get_args

import numpy as np
from numpy.typing import NDArray

from cellctl.kinematics import JointMap, SerialChain
from cellctl.planning.choosing import along, joint_uniform, near_path, partition_of
from cellctl.planning.configurations import Configuration
from cellctl.planning.draws import Draw, Sequence, draw_of
from cellctl.planning.measuring_poses import MeasuringArm, PoseOptions, Sight
from cellctl.planning.touches import OutOfReach
from cellctl.planning.ways import Reach
from cellctl.planning.workspaces import JointRanges, TaskWorkspace

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Method: TypeAlias = Literal["quasi-random", "halton", "joint-uniform", "near-path", "pseudo-random", "clustered"]
METHODS: tuple[Method, ...] = get_args(Method)

_SEQUENCE: dict[Method, Sequence] = {
    "quasi-random": "sobol",
    "halton": "halton",
    "joint-uniform": "sobol",
    "near-path": "sobol",
    "pseudo-random": "pseudo-random",
    "clustered": "clustered",
}
_LEAST_BATCH, _BATCH, _FRUITLESS, _LEAST_SHARE = 64, 512, 8192, 0.01
_PARTS = 20
BEYOND, OUT_OF_REACH = "a joint limit would be passed", "the pose is out of reach in this configuration"


@final
@dataclass(frozen=True, slots=True, eq=False)
class TargetOptions:
    """How targets are chosen, and what rejects one.

    near (n,): a posture, deg, whose configuration all targets have; None: the one that reaches most. dense: samples
    from which joint-uniform and near-path choose; None: 20 for each target (at least 2000) and 2000. partitions: of
    each joint, for joint-uniform; None: 20, or as many as the targets can cover. path (P, 3): polyline, mm, for
    near-path; path_points: points on it. sight: what a station must see (frame: that of the robot file), None: no
    station. floor: height, mm, from which links, TCP and reflectors keep `clearance`; None: no floor.
    """

    near: Array | None = None
    dense: int | None = None
    partitions: int | None = None
    path: Array | None = None
    path_points: int = 50
    sight: Sight | None = None
    floor: float | None = None
    clearance: float = 100.0


@final
@dataclass(frozen=True, slots=True, eq=False)
class TargetSet:
    """N targets. readings (N, n), deg, to 0.0001°; poses (N, 4, 4): nominal TCP there, mm; held_out (N,): for judging.

    drawn: samples drawn; usable: those that can be measured; rejected: how many for which reason. filled (n,): share of
    20 equal parts of each joint's range, over the samples chosen from, that hold a target of the fit.
    """

    readings: Array
    poses: Array
    held_out: Mask
    drawn: int
    usable: int
    rejected: dict[str, int]
    filled: Array

    def __len__(self) -> int:
        return len(self.readings)


def plan_targets(
    chain: SerialChain,
    joints: JointMap,
    reach: Reach,
    region: TaskWorkspace | JointRanges,
    method: Method,
    count: int,
    held_out: int = 0,
    seed: int = 0,
    options: TargetOptions | None = None,
) -> TargetSet:
    """`count` targets for the fit by `method`, and `held_out` more for judging, in random order among them.

    quasi-random: Sobol, scrambled by the seed; halton; joint-uniform: `choosing.joint_uniform` of dense Sobol samples;
    near-path: `choosing.near_path`; pseudo-random and clustered are baselines. Held-out targets are pseudo-random
    points of the same region, for near-path the nearest to the path among as many. Poses and station are in the frame
    of `chain`, with its base.

    Raises OutOfReach where too few are found, with what rejected most; ValueError where options contradict each other.
    """
    options = options or TargetOptions()
    wanted = _wanted(method, count, options)
    finder = _Finder(chain, joints, reach, region, options, np.random.default_rng([seed, 21]))
    dimensions = 6 if isinstance(region, TaskWorkspace) else chain.n
    found = finder.found(draw_of(_SEQUENCE[method], dimensions, count, np.random.default_rng([seed, 22])), wanted)
    chosen = found[_chosen(method, found, finder, count, options, np.random.default_rng([seed, 23]))]
    filled = _filled(found, chosen)
    apart = draw_of("pseudo-random", dimensions, held_out, np.random.default_rng([seed, 24]))
    judges = finder.found(apart, wanted if held_out and method == "near-path" else held_out)
    if method == "near-path":
        judges = judges[_nearest(judges, finder, held_out, options)]
    order = np.random.default_rng([seed, 25]).permutation(count + held_out) if held_out else np.arange(count)
    readings = np.concatenate([chosen, judges])[order]
    return TargetSet(
        readings,
        chain.forward(joints.model(readings)),
        (np.arange(count + held_out) >= count)[order],
        finder.drawn,
        finder.usable,
        dict(finder.rejected),
        filled,
    )


def _wanted(method: Method, count: int, options: TargetOptions) -> int:
    """How many usable samples the method needs."""
    if count < 1:
        raise ValueError("at least one target")
    if method == "near-path" and (options.path is None or len(options.path) < 2):
        raise ValueError("near-path needs a path of at least two points")
    if method not in ("joint-uniform", "near-path"):
        return count
    dense = options.dense or (2000 if method == "near-path" else max(2000, 20 * count))
    if dense < count:
        raise ValueError(f"{count} targets cannot be chosen from {dense} dense samples")
    return dense


def _chosen(
    method: Method, found: Array, finder: _Finder, count: int, options: TargetOptions, rng: np.random.Generator
) -> NDArray[np.int_]:
    """Which of the usable samples `found` (N, n) are targets."""
    if method == "joint-uniform":
        most = max(1, count // found.shape[1])
        return joint_uniform(found, count, min(options.partitions or _PARTS, most), rng)
    if method == "near-path":
        return _nearest(found, finder, count, options)
    return np.arange(count)


def _nearest(found: Array, finder: _Finder, count: int, options: TargetOptions) -> NDArray[np.int_]:
    assert options.path is not None
    return near_path(finder.positions(found), along(options.path, options.path_points), count)


def _filled(usable: Array, chosen: Array) -> Array:
    """Share (n,) of 20 equal parts of each joint's range in `usable` (K, n) that hold one of `chosen` (N, n)."""
    part = partition_of(np.concatenate([usable, chosen]), _PARTS)[len(usable) :]
    return np.array([len(np.unique(mine)) / _PARTS for mine in part.T])


@final
@dataclass
class _Finder:
    """Draws samples and keeps those that can be measured; counts the others by reason."""

    chain: SerialChain
    joints: JointMap
    reach: Reach
    region: TaskWorkspace | JointRanges
    options: TargetOptions
    rng: np.random.Generator
    drawn: int = 0
    usable: int = 0
    rejected: Counter[str] = field(default_factory=Counter)

    def __post_init__(self) -> None:
        self._low = np.array(self.reach.minimum) + self.reach.margin
        self._high = np.array(self.reach.maximum) - self.reach.margin
        if (self._low >= self._high).any():
            raise ValueError(f"the joint limits leave nothing within a margin of {self.reach.margin:g}°")
        self._checks = self._passing()
        self._configuration = self._configured() if isinstance(self.region, TaskWorkspace) else None

    def found(self, draw: Draw, count: int) -> Array:
        """The first `count` usable readings (count, n), deg, of a sequence. Raises OutOfReach where it finds none in
        many batches, or too few.
        """
        kept: list[Array] = []
        batch = min(_BATCH, max(_LEAST_BATCH, 1 << max(count - 1, 0).bit_length()))
        while len(kept) < count:
            if self.drawn >= _FRUITLESS and self.usable < _LEAST_SHARE * self.drawn:
                raise self._too_few(len(kept), count)
            passed = self._usable(draw.random(batch))
            self.usable += len(passed)
            kept.extend(passed)
        return np.array(kept[:count]).reshape(count, self.chain.n)

    def positions(self, readings: Array) -> Array:
        """Nominal TCP positions (N, 3), mm."""
        return np.asarray(self.chain.forward(self.joints.model(readings))[:, :3, 3])

    def _usable(self, unit: Array) -> Array:
        self.drawn += len(unit)
        readings = np.round(self._reached(unit), 4)
        for reason, passes in self._checks:
            if not len(readings):
                break
            passed = passes(readings)
            self.rejected[reason] += int(np.count_nonzero(~passed))
            readings = readings[passed]
        return readings

    def _reached(self, unit: Array) -> Array:
        if isinstance(self.region, JointRanges):
            readings = self.region.readings(unit)
            within = ((readings >= self._low) & (readings <= self._high)).all(axis=1)
            self.rejected[BEYOND] += int(np.count_nonzero(~within))
            return readings[within]
        assert self._configuration is not None
        readings, usable, beyond = self._configuration.readings(self.region.poses(unit))
        self.rejected[BEYOND] += int(np.count_nonzero(beyond))
        self.rejected[OUT_OF_REACH] += int(np.count_nonzero(~usable & ~beyond))
        return readings[usable]

    def _configured(self) -> Configuration:
        assert isinstance(self.region, TaskWorkspace)
        if self.options.near is not None:
            return Configuration(self.chain, self.joints, self._low, self._high, self.options.near)
        probes = self.region.poses(draw_of("sobol", 6, 0, self.rng).random(64))
        found = Configuration.suiting(self.chain, self.joints, self._low, self._high, probes, self.rng)
        if found is None:
            raise OutOfReach(
                "no pose of the workspace is reached within the joint limits: check its frame (that of the robot file, "
                "to the TCP of the robot file's tool), units (mm, degrees) and angles"
            )
        return found

    def _passing(self) -> list[tuple[str, Callable[[Array], Mask]]]:
        """What a station and a floor demand; the visibility is that of the tracker campaign."""
        sight, options = self.options.sight, self.options
        tcp = self.chain.tool_now[None, :3, 3]
        shown = sight or Sight(np.zeros(3), tcp, np.array([[0.0, 0.0, 1.0]]))
        pose_options = PoseOptions(side=(1,) * self.chain.n, floor=options.floor, clearance=options.clearance)
        arm = MeasuringArm(self.chain, self.joints, shown, np.zeros(self.chain.n), pose_options)
        checks: list[tuple[str, Callable[[Array], Mask]]] = []
        if sight is not None:
            checks += [
                ("no reflector faces the station in range", arm.faces_station),
                ("the arm is in the beam", arm.free_beam),
            ]
        if options.floor is not None:
            checks.append(("the arm would come too near the floor", arm.above_floor))
        return checks

    def _too_few(self, found: int, count: int) -> OutOfReach:
        most = max(self.rejected, key=lambda reason: self.rejected[reason])
        return OutOfReach(
            f"only {found} of {count} targets found among {self.drawn} samples; most were rejected because {most} "
            f"({self.rejected[most]}): move or shrink the region, or widen what rejects them"
        )
