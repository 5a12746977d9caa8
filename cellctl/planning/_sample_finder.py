"""From points of the unit cube to joint readings that can be measured: in reach, within limits, visible, clear."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Self, final

import numpy as np
from numpy.typing import NDArray

from cellctl.kinematics import (
    InverseResult,
    JointMap,
    SerialChain,
    inverse,
    inverse_from_all,
    nearest_turn,
    rotation_vector,
)
from cellctl.kinematics.low_discrepancy import spread_over
from cellctl.planning._workspaces import Draw, JointRanges, TaskWorkspace, draw_of
from cellctl.planning.measuring_poses import MeasuringArm, PoseOptions, Sight
from cellctl.planning.touches import OutOfReach
from cellctl.planning.ways import Reach

Array = NDArray[np.float64]

Mask = NDArray[np.bool_]

_STARTS, _PROBES, _TRIED = 64, 24, 8
_TOLERANCE_MM, _TOLERANCE_RAD = 1e-6, 1e-9

_LEAST_BATCH, _BATCH = 64, 512
_FRUITLESS, _LEAST_SHARE = 8192, 0.01
"""After so many samples, a region of which a smaller share is usable is given up."""

BEYOND, OUT_OF_REACH = "a joint limit would be passed", "the pose is out of reach in this configuration"


@final
@dataclass(frozen=True, slots=True, eq=False)
class TargetOptions:
    """How targets are chosen, and what rejects one.

    near (n,): a posture, deg, whose configuration all targets have; None: the one that reaches most. dense: samples
    from which joint-uniform, optimal and near-path choose; None: 20 for each target (at least 2000) and 2000.
    partitions: of each joint, for joint-uniform; None: 20, or as many as the targets can cover. path (P, 3): polyline,
    mm, for near-path; path_points: points on it. sight: what a station must see (frame: that of the robot file), None:
    no station. floor: height, mm, from which links, TCP and reflectors keep `clearance`; None: no floor. choose: for
    optimal: from readings (M, n), deg, and a count, the indices (count,) of the targets.
    """

    near: Array | None = None
    dense: int | None = None
    partitions: int | None = None
    path: Array | None = None
    path_points: int = 50
    sight: Sight | None = None
    floor: float | None = None
    clearance: float = 100.0
    choose: Callable[[Array, int], NDArray[np.int_]] | None = None


@final
@dataclass
class SampleFinder:
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
            what = f"the joint limits leave nothing within a margin of {self.reach.margin:g}°"
            raise ValueError(f"{what}: check the limits in the robot file")
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


@final
class Configuration:
    """A posture of the arm (n,), deg, from which the inverse starts, so that all targets have the same configuration.

    low, high (n,): the readings allowed, deg. A pose that Newton's steps do not reach from the posture is tried once
    more, from the nearest pose that was reached.
    """

    def __init__(self, chain: SerialChain, joints: JointMap, low: Array, high: Array, near: Array) -> None:
        self._chain, self._joints, self._low, self._high = chain, joints, low, high
        self.near = near

    @classmethod
    def suiting(
        cls, chain: SerialChain, joints: JointMap, low: Array, high: Array, poses: Array, rng: np.random.Generator
    ) -> Self | None:
        """The configuration in which most of `poses` (N, 4, 4) are reached; None where none of them is reached.

        Candidates: solutions of the first poses from starts spread over the joints. Of equal ones, the one nearest to
        the middle of the limits, in shares of their width.
        """
        probes = poses[:_PROBES]
        starts = joints.model(spread_over(low, high, _STARTS, rng=rng))
        found = inverse_from_all(chain, probes[:4], starts, tolerance_mm=_TOLERANCE_MM, tolerance_rad=_TOLERANCE_RAD)
        readings, inside, _ = cls(chain, joints, low, high, (low + high) / 2.0)._within_limits(found)
        candidates = readings[inside]
        if not len(candidates):
            return None
        from_middle = (candidates - (low + high) / 2.0) / np.maximum(high - low, 1e-9)
        best = np.argsort(np.sum(from_middle**2, axis=1), kind="stable")
        different = [best[0]]
        for place in best[1:]:
            if len(different) < _TRIED and _apart(candidates[place], candidates[different]):
                different.append(place)
        tried = [cls(chain, joints, low, high, candidates[place]) for place in different]
        counts = [int(np.count_nonzero(each.readings(probes)[1])) for each in tried]
        return tried[int(np.argmax(counts))]

    def readings(self, poses: Array) -> tuple[Array, Mask, Mask]:
        """Readings (N, n), deg, at which the TCP is at `poses` (N, 4, 4); which (N,) are usable; which of the others
        are reached, but only beyond the limits.
        """
        readings, inside, reached = self._solved(poses, self.near)
        again = np.flatnonzero(~inside)
        if inside.any() and again.size:
            start = readings[inside][_nearest(poses[again], poses[inside], self._chain.reach_mm)]
            other, other_inside, other_reached = self._solved(poses[again], start)
            better = other_inside | (other_reached & ~reached[again])
            readings[again[better]] = other[better]
            inside[again], reached[again] = other_inside, reached[again] | other_reached
        return readings, inside, reached & ~inside

    def _solved(self, poses: Array, start: Array) -> tuple[Array, Mask, Mask]:
        begin = self._joints.model(start)
        found = inverse(self._chain, poses, begin, tolerance_mm=_TOLERANCE_MM, tolerance_rad=_TOLERANCE_RAD)
        return self._within_limits(found)

    def _within_limits(self, found: InverseResult) -> tuple[Array, Mask, Mask]:
        """Readings (..., n), deg, nearest to `near` or else a turn away; which (...) are usable; which are reached."""
        solved = self._joints.readings(found.q)
        readings = nearest_turn(solved, self.near, 180.0)
        readings = readings - 360.0 * (readings > self._high) * (readings - 360.0 >= self._low)
        readings = readings + 360.0 * (readings < self._low) * (readings + 360.0 <= self._high)
        if self._joints.prismatic is not None:
            readings = np.where(self._joints.prismatic, solved, readings)
        within = ((readings >= self._low) & (readings <= self._high)).all(axis=-1)
        return readings, found.converged & within, found.converged


def _apart(one: Array, others: Array) -> bool:
    """Whether a posture (n,) is of another configuration than `others` (m, n): some joint differs by more than 45°."""
    return bool((np.abs(others - one).max(axis=1) > 45.0).all())


def _nearest(poses: Array, known: Array, reach: float) -> NDArray[np.int_]:
    """Index (N,) of the nearest of `known` (K, 4, 4): distance, and rotation times the arm's reach."""
    best = np.zeros(len(poses), int)
    for place, each in enumerate(poses):
        away = np.linalg.norm(known[:, :3, 3] - each[:3, 3], axis=1)
        turn = np.linalg.norm(rotation_vector(known[:, :3, :3] @ each[:3, :3].T), axis=1)
        best[place] = int(np.argmin(away + reach * turn))
    return best
