"""Targets for a calibration with any instrument: drawn by one of several methods, and chosen among the possible.

A method draws points of a region (`workspaces`), finds their joint readings, rejects what cannot be measured, and
chooses. The same seed gives the same targets.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias, final, get_args

import numpy as np
from numpy.typing import NDArray

from cellctl.kinematics import JointMap, SerialChain
from cellctl.planning._sample_finder import SampleFinder, TargetOptions
from cellctl.planning._workspaces import JointRanges, Sequence, TaskWorkspace, draw_of
from cellctl.planning.ways import Reach

Array = NDArray[np.float64]
Indices = NDArray[np.int_]


def partition_of(readings: Array, partitions: int) -> Indices:
    """Number (N, n) of the partition in which each reading (N, n) lies, of `partitions` equal ones for each joint from
    its least to its greatest reading. A joint that never moves is all in partition 0.
    """
    low, width = readings.min(axis=0), np.ptp(readings, axis=0)
    share = np.divide(readings - low, width, out=np.zeros(readings.shape), where=width > 1e-9)
    return np.asarray(np.minimum((share * partitions).astype(int), partitions - 1))


def joint_uniform(readings: Array, count: int, partitions: int, rng: np.random.Generator) -> Indices:
    """`count` of dense samples `readings` (N, n), so that each joint's partitions are filled evenly (KRG, 2.4).

    Each joint's range is divided into `partitions` equal parts. Next is always a random sample of the part that holds
    the fewest chosen ones (a random one of these parts). So every part that has a sample is covered where `count` is
    at least the number of parts. Raises ValueError for more than N.
    """
    if count > len(readings):
        raise ValueError(f"{count} of {len(readings)} samples")
    part = partition_of(readings, partitions)
    joints = np.arange(readings.shape[1])
    filled, left = np.zeros((len(joints), partitions), int), np.zeros((len(joints), partitions), int)
    for joint in joints:
        left[joint] = np.bincount(part[:, joint], minlength=partitions)
    free, chosen = np.ones(len(readings), bool), np.zeros(count, int)
    for place in range(count):
        emptiest = np.where(left > 0, filled, count + 1)
        joint, number = rng.choice(np.argwhere(emptiest == emptiest.min()))
        sample = rng.choice(np.flatnonzero(free & (part[:, joint] == number)))
        chosen[place], free[sample] = sample, False
        filled[joints, part[sample]] += 1
        left[joints, part[sample]] -= 1
    return chosen


def along(path: Array, count: int) -> Array:
    """`count` points (count, 3) at equal distances along the polyline `path` (P, 3), its ends among them."""
    lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    at = np.linspace(0.0, lengths[-1], count)
    return np.stack([np.interp(at, lengths, path[:, axis]) for axis in range(3)], axis=1)


def near_path(positions: Array, path: Array, count: int) -> Indices:
    """`count` different ones of `positions` (N, 3), nearest to points `path` (P, 3), mm (ANN, 3.4.1).

    The paper takes the 10 nearest to each of 50 points, which leaves fewer than 500 different ones. The rule here: the
    nearest to each point along the path, then the second nearest to each, and so on; those already taken are passed
    over, until `count` are taken. With enough of them, the union of the 10 nearest is always among them. Raises
    ValueError for more than N.
    """
    from scipy.spatial.distance import cdist  # at first use: it takes 0.2 s

    if count > len(positions):
        raise ValueError(f"{count} of {len(positions)} samples")
    ranked = np.argsort(cdist(path, positions), axis=1, kind="stable").T.ravel()
    _, first = np.unique(ranked, return_index=True)
    return np.asarray(ranked[np.sort(first)[:count]])


BLOCK = 10
"""Targets of a block: a few minutes of a measurement."""


def in_blocks(readings: Array, rng: np.random.Generator) -> Indices:
    """Order (N,) of targets `readings` (N, n), deg: blocks drawn at random, within each the short way.

    A drift of the instrument or of the robot's temperature over the measurement is then not the error of a place: every
    part of the region is in every part of the time. In random order alone the robot would cross the cell for each
    target. The way within a block: always to the nearest one left, by the joint that has furthest to turn.
    """
    order: list[int] = []
    for block in np.array_split(rng.permutation(len(readings)), max(1, round(len(readings) / BLOCK))):
        left = block.tolist()
        while left:
            away = np.abs(readings[left] - readings[order[-1]]).max(axis=1) if order else np.zeros(len(left))
            order.append(left.pop(int(np.argmin(away))))
    return np.array(order, int)


Mask = NDArray[np.bool_]
Method: TypeAlias = Literal[
    "quasi-random", "halton", "joint-uniform", "near-path", "optimal", "pseudo-random", "clustered"
]
METHODS: tuple[Method, ...] = get_args(Method)

_SEQUENCE: dict[Method, Sequence] = {
    "quasi-random": "sobol",
    "halton": "halton",
    "joint-uniform": "sobol",
    "near-path": "sobol",
    "optimal": "sobol",
    "pseudo-random": "pseudo-random",
    "clustered": "clustered",
}
_PARTS = 20
"""Parts of each joint, where the targets can cover as many."""


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

    quasi-random: Sobol, scrambled by the seed; halton; joint-uniform: `joint_uniform` of dense Sobol samples;
    near-path: `near_path` of these; optimal: what `TargetOptions.choose` takes of them; pseudo-random and clustered are
    baselines. Held-out targets are pseudo-random points of the same region, for near-path the nearest to the path among
    as many. Optimal targets, with the held-out ones among them, are in blocks (`in_blocks`), others in random order.
    Poses and station are in the frame of `chain`, with its base.

    Raises OutOfReach where too few are found, with what rejected most; ValueError where options contradict each other.
    """
    options = options or TargetOptions()
    wanted = _wanted(method, count, held_out, region, options)

    finder = SampleFinder(chain, joints, reach, region, options, np.random.default_rng([seed, 21]))
    dimensions = 6 if isinstance(region, TaskWorkspace) else chain.n
    found = finder.found(draw_of(_SEQUENCE[method], dimensions, count, np.random.default_rng([seed, 22])), wanted)
    chosen = found[_chosen(method, found, finder, count, options, np.random.default_rng([seed, 23]))]
    filled = _filled(found, chosen)
    apart = draw_of("pseudo-random", dimensions, held_out, np.random.default_rng([seed, 24]))
    judges = finder.found(apart, wanted if held_out and method == "near-path" else held_out)
    if method == "near-path":
        judges = judges[_nearest(judges, finder, held_out, options)]
    readings, rng = np.concatenate([chosen, judges]), np.random.default_rng([seed, 25])
    if method == "optimal":
        order = in_blocks(readings, rng)
    else:
        order = rng.permutation(count + held_out) if held_out else np.arange(count)
    readings = readings[order]
    return TargetSet(
        readings,
        chain.forward(joints.model(readings)),
        (np.arange(count + held_out) >= count)[order],
        finder.drawn,
        finder.usable,
        dict(finder.rejected),
        filled,
    )


def _wanted(
    method: Method, count: int, held_out: int, region: TaskWorkspace | JointRanges, options: TargetOptions
) -> int:
    """How many usable samples the method needs."""
    if method == "optimal" and options.choose is None:
        raise ValueError("optimal needs what chooses: `TargetOptions.choose`")
    if method not in ("joint-uniform", "near-path", "optimal"):
        return count
    if method == "near-path":
        _check_path(region, options.path)
    dense = options.dense or (2000 if method == "near-path" else max(2000, 20 * count))
    if dense < max(count, held_out):
        raise ValueError(f"{max(count, held_out)} targets cannot be chosen from {dense} samples: give more dense ones")
    return dense


def _check_path(region: TaskWorkspace | JointRanges, path: Array | None) -> None:
    if path is None or len(path) < 2:
        raise ValueError("near-path needs a path: give two points or more")
    if isinstance(region, TaskWorkspace) and not region.holds(path):
        raise ValueError("the path leaves the box that targets are drawn from: give a box that holds the whole path")


def _chosen(
    method: Method, found: Array, finder: SampleFinder, count: int, options: TargetOptions, rng: np.random.Generator
) -> NDArray[np.int_]:
    """Which of the usable samples `found` (N, n) are targets."""
    if method == "joint-uniform":
        most = max(1, count // found.shape[1])
        return joint_uniform(found, count, min(options.partitions or _PARTS, most), rng)
    if method == "near-path":
        return _nearest(found, finder, count, options)
    if method == "optimal":
        assert options.choose is not None
        return options.choose(found, count)
    return np.arange(count)


def _nearest(found: Array, finder: SampleFinder, count: int, options: TargetOptions) -> NDArray[np.int_]:
    assert options.path is not None
    return near_path(finder.positions(found), along(options.path, options.path_points), count)


def _filled(usable: Array, chosen: Array) -> Array:
    """Share (n,) of 20 equal parts of each joint's range in `usable` (K, n) that hold one of `chosen` (N, n)."""
    part = partition_of(np.concatenate([usable, chosen]), _PARTS)[len(usable) :]
    return np.array([len(np.unique(mine)) / _PARTS for mine in part.T])
