"""From points of the unit cube to joint readings that can be measured: in reach, within limits, visible, clear."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import final

import numpy as np
from numpy.typing import NDArray

from cellctl.kinematics import JointMap, SerialChain
from cellctl.planning.configurations import Configuration
from cellctl.planning.draws import Draw, draw_of
from cellctl.planning.measuring_poses import MeasuringArm, PoseOptions, Sight
from cellctl.planning.target_options import TargetOptions
from cellctl.planning.touches import OutOfReach
from cellctl.planning.ways import Reach
from cellctl.planning.workspaces import JointRanges, TaskWorkspace

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_LEAST_BATCH, _BATCH = 64, 512
_FRUITLESS, _LEAST_SHARE = 8192, 0.01
"""After so many samples, a region of which a smaller share is usable is given up."""

BEYOND, OUT_OF_REACH = "a joint limit would be passed", "the pose is out of reach in this configuration"


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
