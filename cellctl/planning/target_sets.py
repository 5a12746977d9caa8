"""Targets for a calibration with any instrument, drawn by one of several methods, within limits, visible and clear.

A method draws points of a region (`workspaces`), finds their joint readings, rejects what cannot be measured, and
chooses. The same seed gives the same targets.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias, final, get_args

import numpy as np
from numpy.typing import NDArray

from cellctl.kinematics import JointMap, SerialChain
from cellctl.planning.choosing import along, joint_uniform, near_path, partition_of
from cellctl.planning.draws import Sequence, draw_of
from cellctl.planning.sample_finder import SampleFinder
from cellctl.planning.target_options import TargetOptions
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

    quasi-random: Sobol, scrambled by the seed; halton; joint-uniform: `choosing.joint_uniform` of dense Sobol samples;
    near-path: `choosing.near_path`; pseudo-random and clustered are baselines. Held-out targets are pseudo-random
    points of the same region, for near-path the nearest to the path among as many. Poses and station are in the frame
    of `chain`, with its base.

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


def _wanted(
    method: Method, count: int, held_out: int, region: TaskWorkspace | JointRanges, options: TargetOptions
) -> int:
    """How many usable samples the method needs."""
    if method not in ("joint-uniform", "near-path"):
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
    return np.arange(count)


def _nearest(found: Array, finder: SampleFinder, count: int, options: TargetOptions) -> NDArray[np.int_]:
    assert options.path is not None
    return near_path(finder.positions(found), along(options.path, options.path_points), count)


def _filled(usable: Array, chosen: Array) -> Array:
    """Share (n,) of 20 equal parts of each joint's range in `usable` (K, n) that hold one of `chosen` (N, n)."""
    part = partition_of(np.concatenate([usable, chosen]), _PARTS)[len(usable) :]
    return np.array([len(np.unique(mine)) / _PARTS for mine in part.T])
