"""Which of many possible targets to measure: uniform over each joint, or nearest to a path."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

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
    if count > len(positions):
        raise ValueError(f"{count} of {len(positions)} samples")
    ranked = np.argsort(cdist(path, positions), axis=1, kind="stable").T.ravel()
    _, first = np.unique(ranked, return_index=True)
    return np.asarray(ranked[np.sort(first)[:count]])
