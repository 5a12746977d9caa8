"""Plans the targets of a proof, and the poses from which a model is identified or registered."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol, final

import numpy as np

from cellctl.files import InputError, Problem
from cellctl.formats import ModelFile, RobotFile, postures_of
from cellctl.formats.table_making import valid_region
from cellctl.kinematics import Floats
from cellctl.planning import OutOfReach
from cellctl.planning.measuring_poses import Counts, MeasuringArm, measuring_postures, plan_given_poses
from cellctl.planning.ways import Reach
from cellctl.procedure import CellContext
from procedures.steps.tracker.compensable import Compensable, MannerWanted, manner_of
from procedures.steps.tracker.given_poses import GivenPoses
from procedures.steps.tracker.plans import Round
from procedures.steps.tracker.pose_planning import pose_limits, pose_seed, rounds_of
from procedures.steps.tracker.rows import LeftOut, TargetPlanRow

LEAST_TARGETS = 3
"""Fewer targets prove nothing."""

_INSIDE_DEG = 1.0
"""Planned targets keep this distance from the end of the measured region: their compensated joints are inside, too."""


class Wanted(MannerWanted, Protocol):
    """The procedure's settings."""

    @property
    def fit(self) -> int:
        """Poses from which a model is identified, if none was read."""

    @property
    def registration(self) -> int:
        """Poses from which a model that was read is registered."""

    @property
    def targets(self) -> int:
        """Targets, at most."""

    @property
    def target_file(self) -> str:
        """File of the targets, from the cell file's folder; empty: they are planned."""

    @property
    def monuments_every(self) -> int:
        """Poses between two visits to the monuments."""

    @property
    def from_both(self) -> float:
        """Share of the poses of an identification that are measured from both sides."""


@final
@dataclass(frozen=True, slots=True)
class TargetPlan:
    """All visits before the compensation, in rounds, and the row to record."""

    rounds: list[Round]
    row: TargetPlanRow


@final
@dataclass(frozen=True, eq=False)
class _Candidates:
    """Postures (N, n), deg, each with its name, and why it is left out: empty where it is not."""

    readings: Floats
    names: Sequence[str]
    reasons: Sequence[str]

    def first(self, count: int) -> tuple[Floats, tuple[LeftOut, ...]]:
        """The first `count` usable ones, and those left out before them."""
        usable = [place for place, reason in enumerate(self.reasons) if not reason][:count]
        end = usable[-1] if len(usable) == count else len(self.reasons)
        left_out = (
            LeftOut(target=self.names[place], reason=reason)
            for place, reason in enumerate(self.reasons[:end])
            if reason
        )
        return self.readings[usable], tuple(left_out)


def planned_targets(context: CellContext, wanted: Wanted, model: ModelFile | None) -> TargetPlan:
    """The poses of the fit and the targets, half of the targets between these poses, half after them.

    model: the one that was read; targets that it cannot compensate are left out, and its poses are inside its measured
    region. Raises InputError if too few targets are left, or too few poses can be measured.
    """
    robot = RobotFile.load(context.robot_file)
    home = np.array(postures_of(context.cell, robot, "turn").home)
    reach, sight, options = pose_limits(context, 1)
    chain, joints = robot.chain(), robot.joint_map()
    arm = MeasuringArm(chain.with_base(np.eye(4)), joints, sight, home, options)
    planner = _Planner(context, wanted, robot, arm, reach, model)
    fit, candidates = planner.poses()
    targets, left_out = candidates.first(wanted.targets)
    if len(targets) < LEAST_TARGETS:
        raise InputError(_too_few(context, len(targets), left_out))
    from_both = 0.0 if model else wanted.from_both
    counts = Counts(len(fit), len(targets), len(targets) // 2, from_both)
    postures = np.concatenate([fit, targets])
    visits = plan_given_poses(chain, joints, sight, counts, home, pose_seed(context), postures, options)
    rounds = rounds_of(context, visits, home, wanted.monuments_every)
    return TargetPlan(rounds, TargetPlanRow(targets=len(targets), left_out=left_out))


@final
@dataclass(frozen=True, eq=False)
class _Planner:
    context: CellContext
    wanted: Wanted
    robot: RobotFile
    arm: MeasuringArm
    reach: Reach
    model: ModelFile | None

    def poses(self) -> tuple[Floats, _Candidates]:
        """Postures of the fit (F, n), deg, and the candidates for targets."""
        count = self.wanted.registration if self.model else self.wanted.fit
        if not self.wanted.target_file:
            drawn = self._drawn(count + self.wanted.targets)
            names = [f"planned target {number}" for number in range(1, self.wanted.targets + 1)]
            return drawn[:count], self._candidates(drawn[count:], names, [""] * len(names))
        file = Path(self.context.cell.file).parent / self.wanted.target_file
        given = GivenPoses.read(file, self.robot, self.arm, self.reach)
        fit = [at for at, of in enumerate(given.sets) if of == "fit" and at not in given.reasons]
        mine = [at for at, of in enumerate(given.sets) if of != "fit"]
        candidates = self._candidates(
            given.readings[mine],
            [f"line {given.lines[at]} of {file.name}" for at in mine],
            [f"cannot be measured: {given.reasons[at]}" if at in given.reasons else "" for at in mine],
        )
        return given.readings[fit[:count]] if len(fit) >= count else self._drawn(count), candidates

    def _candidates(self, readings: Floats, names: Sequence[str], reasons: Sequence[str]) -> _Candidates:
        if self.model is None or not len(readings):
            return _Candidates(readings, names, reasons)
        manner = manner_of(self.context, self.wanted)
        found = Compensable.of(self.model, readings, manner).reasons
        return _Candidates(readings, names, [ours or theirs for ours, theirs in zip(reasons, found, strict=True)])

    def _drawn(self, count: int) -> Floats:
        try:
            return measuring_postures(self.arm, self._inside(), count, pose_seed(self.context))
        except OutOfReach as error:
            cure = "move the station, turn the reflector on the flange, or ask for fewer poses"
            raise InputError(self.context.cell.problem(("reflectors", "on_flange"), str(error), cure)) from error

    def _inside(self) -> Reach:
        """The joints of planned poses: inside the measured region of a model that was read."""
        if self.model is None:
            return self.reach
        region, margin = valid_region(self.model), self.reach.margin + self.arm.options.step - _INSIDE_DEG
        low, high = np.array(region.min) - margin, np.array(region.max) + margin
        return replace(
            self.reach,
            minimum=tuple(np.maximum(self.reach.minimum, low).tolist()),
            maximum=tuple(np.minimum(self.reach.maximum, high).tolist()),
        )


def _too_few(context: CellContext, found: int, left_out: Sequence[LeftOut]) -> list[Problem]:
    what = f"{found} targets are left, and {LEAST_TARGETS} at least prove something"
    named = (Problem(context.cell.file, 0, 0, str(each)) for each in left_out)
    cure = "give targets inside the measured region that the reflector can be seen at"
    return [Problem(context.cell.file, 0, 0, what, cure), *named]
