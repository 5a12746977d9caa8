"""Measuring poses of the cell's robot: planned or from a file, for the identification, registration or a proof."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path
from typing import Self, final

import numpy as np

from cellctl.files import InputError, Problem
from cellctl.formats import (
    DataSet,
    ModelFile,
    RobotFile,
    Sieve,
    floor_of,
    joint_readings,
    postures_of,
    reflectors_of,
    station_of,
    valid_region,
)
from cellctl.kinematics import Floats
from cellctl.planning import (
    Counts,
    MeasuringArm,
    MeasuringPoses,
    OutOfReach,
    PoseOptions,
    Reach,
    Sight,
    measuring_postures,
    plan_given_poses,
    plan_measuring_poses,
    unmeasurable,
)
from cellctl.procedure import CellContext
from procedures.steps.sphere.planning import spheres_around
from procedures.steps.tracker.circles import return_pose, rounded, turn_posture
from procedures.steps.tracker.plan_inputs import PlanInputs, PlanTargetsInputs
from procedures.steps.tracker.pose_choice import chosen_postures
from procedures.steps.tracker.pose_plans import PosePlan, Round
from procedures.steps.tracker.rows import LeftOut, TargetPlanRow
from procedures.steps.tracker.station import rough_station
from procedures.steps.tracker.target_table import Compensable, compensation_settings

_CURE = "plan the targets for this cell's station and reflector, or move the station"


@final
@dataclass(frozen=True, eq=False)
class GivenPoses:
    """The targets of a file. readings (N, n), deg; sets, lines (N,); reasons: place → why it cannot be measured."""

    file: str
    readings: Floats
    sets: tuple[str, ...]
    lines: tuple[int, ...]
    reasons: dict[int, str]

    @classmethod
    def read(cls, file: Path, robot: RobotFile, arm: MeasuringArm, reach: Reach) -> Self:
        """Raises InputError with every row whose joints cannot be read."""
        data = DataSet.load(file)
        sieve = Sieve(data)
        readings = np.round(joint_readings(sieve, robot), 4)
        if sieve.rejected():
            raise InputError(Problem(data.file, row.line, 0, row.reason) for row in sieve.rejected())
        return cls(data.file, readings, tuple(data.texts("set")), data.lines, unmeasurable(arm, reach, readings))

    def first(self, fit: int, held_out: int) -> Floats:
        """The first postures (fit + held_out, n) of sets `fit` and `test` that can be measured. Raises InputError if a
        set has too few, with every row that cannot be measured.
        """
        chosen: list[int] = []
        for name, count in (("fit", fit), ("test", held_out)):
            usable = [place for place, of in enumerate(self.sets) if of == name and place not in self.reasons]
            if len(usable) < count:
                raise InputError(self._too_few(name, len(usable), count))
            chosen.extend(usable[:count])
        return self.readings[chosen]

    def _too_few(self, name: str, found: int, count: int) -> list[Problem]:
        what = f"{found} targets of set '{name}' can be measured; the procedure asks for {count}"
        own = [place for place in self.reasons if self.sets[place] == name]
        refused = (
            Problem(self.file, self.lines[place], 0, f"cannot be measured: {self.reasons[place]}", _CURE)
            for place in own
        )
        return [Problem(self.file, 0, 0, what, "plan more of them, or ask for fewer poses"), *refused]


_MARGIN_DEG = 3.0
"""Margin of the reflector's acceptance, and of the joint limits."""

_NEAREST_MM = 1600.0
"""Least distance from the instrument: laser stations measure from 1.5 m."""

_WIDEST_DEG = 180.0
"""No joint is turned farther from 0 than this: more turns show nothing new, and twist the cables."""


def planned_rounds(context: CellContext, inputs: PlanInputs, station: Floats | None) -> list[Round]:
    """The poses in rounds of `monuments_every`; station (4, 4): the instrument in the base frame, None: the cell
    file's. Raises InputError if too few poses can be measured.
    """
    robot = RobotFile.load(context.robot_file)
    home = np.array(postures_of(context.cell, robot, "turn").home)
    return rounds_of(context, _poses(context, robot, inputs, station, home), home, inputs.monuments_every)


def rounds_of(
    context: CellContext, poses: MeasuringPoses, home: Floats, monuments_every: int, number: int = 0
) -> list[Round]:
    """Visits in rounds of `monuments_every`, each from the return pose and back to it; home (n,), deg. number: of the
    first visit.
    """
    plans = _plans(context, poses, home, number)
    after = number + len(plans)
    rounds = [plans[first : first + monuments_every] for first in range(0, len(plans), monuments_every)]
    return [
        Round(poses=_from_return_pose(context, each, home), back=_back(context, each, home, after + place))
        for place, each in enumerate(rounds)
    ]


def pose_limits(
    context: CellContext, reflectors: int, station: Floats | None = None
) -> tuple[Reach, Sight, PoseOptions]:
    """What limits the poses at which that many reflectors are measured; station: as for `planned_rounds`."""
    robot = RobotFile.load(context.robot_file)
    given, given_station, floor = reflectors_of(context.cell), station_of(context.cell), floor_of(context.cell)
    mine = given.on_flange[:reflectors]
    sight = Sight(
        (rough_station(context) if station is None else station)[:3, 3],
        np.array([one.xyz for one in mine]),
        np.array([one.facing for one in mine]),
        given.acceptance_deg - _MARGIN_DEG,
        nearest=_NEAREST_MM,
        nests=np.array([nest.xyz for nest in given_station.nests], float).reshape(-1, 3),
        search=given_station.search_mm,
    )
    reach = Reach(
        tuple(max(joint.min, -_WIDEST_DEG) for joint in robot.joints),
        tuple(min(joint.max, _WIDEST_DEG) for joint in robot.joints),
        margin=_MARGIN_DEG,
    )
    options = PoseOptions(side=(1,) * len(robot.joints), around=spheres_around(context))
    if floor:
        options = replace(options, floor=floor.z, clearance=floor.clearance_mm)
    return reach, sight, options


def pose_seed(context: CellContext, purpose: str = "poses") -> int:
    """Of the poses that are drawn in a run for this purpose."""
    return int.from_bytes(sha256(f"{context.seed}/{purpose}".encode()).digest()[:4])


@contextmanager
def enough_in_reach(context: CellContext) -> Iterator[None]:
    """Raises InputError, with place and cure, where too few poses can be measured."""
    try:
        yield
    except OutOfReach as error:
        cure = "move the station, turn the reflector on the flange, or ask for fewer poses"
        raise InputError(context.cell.problem(("reflectors", "on_flange"), str(error), cure)) from error


def _poses(
    context: CellContext, robot: RobotFile, inputs: PlanInputs, station: Floats | None, home: Floats
) -> MeasuringPoses:
    reach, sight, options = pose_limits(context, inputs.reflectors, station)
    fit, held_out = inputs.at_first, inputs.held_out_at_first
    counts = Counts(fit, held_out, inputs.late, inputs.from_both)
    seed = pose_seed(context)
    chain, joints = robot.chain(), robot.joint_map()
    if inputs.pose_file:
        file = Path(context.cell.file).parent / inputs.pose_file
        arm = MeasuringArm(chain.with_base(np.eye(4)), joints, sight, home, options)
        postures = GivenPoses.read(file, robot, arm, reach).first(fit, held_out)
        return plan_given_poses(chain, joints, sight, counts, home, seed, postures, options)
    with enough_in_reach(context):
        if inputs.goal_mm or inputs.choice == "optimal":
            arm = MeasuringArm(chain.with_base(np.eye(4)), joints, sight, home, options)
            postures = chosen_postures(robot, arm, reach, fit, held_out, seed, sight.reflectors)
            return plan_given_poses(chain, joints, sight, counts, home, seed, postures, options)
        return plan_measuring_poses(chain, joints, reach, sight, counts, home, seed, options)


def _plans(context: CellContext, poses: MeasuringPoses, home: Floats, first: int) -> list[PosePlan]:
    name = reflectors_of(context.cell).on_flange[0].id
    plans = []
    for place in range(len(poses)):
        origin = poses.readings[place - 1] if place else home
        over = [rounded(home)] if poses.over_home[place] else []
        plans.append(
            PosePlan(
                number=first + place,
                kind="test" if poses.held_out[place] else "fit",
                reflector=name,
                origin=rounded(origin),
                way=[*over, rounded(poses.approach[place])],
                joints=rounded(poses.readings[place]),
                direction=poses.side[place].tolist(),
            )
        )
    return plans


def _from_return_pose(context: CellContext, poses: list[PosePlan], home: Floats) -> list[PosePlan]:
    """The round, its first pose reached from the return pose over home."""
    way = [rounded(home), poses[0].way[-1]]
    return [poses[0].model_copy(update={"origin": rounded(turn_posture(context)), "way": way}), *poses[1:]]


def _back(context: CellContext, poses: list[PosePlan], home: Floats, number: int) -> PosePlan:
    """The return pose after a round, over home."""
    back = return_pose(context, poses[-1].joints, number)
    return back.model_copy(update={"way": [rounded(home), *back.way]})


LEAST_TARGETS = 3
"""Fewer targets prove nothing."""

_INSIDE_DEG = 1.0
"""Planned targets keep this distance from the end of the measured region: their compensated joints are inside, too."""


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


def planned_targets(context: CellContext, inputs: PlanTargetsInputs, model: ModelFile | None) -> TargetPlan:
    """The poses of the fit and the targets, half of the targets between these poses, half after them.

    model: the one that was read; targets that it cannot compensate are left out, and its poses are inside its measured
    region. Raises InputError if too few targets are left, or too few poses can be measured.
    """
    robot = RobotFile.load(context.robot_file)
    home = np.array(postures_of(context.cell, robot, "turn").home)
    reach, sight, options = pose_limits(context, 1)
    chain, joints = robot.chain(), robot.joint_map()
    arm = MeasuringArm(chain.with_base(np.eye(4)), joints, sight, home, options)
    planner = _Planner(context, inputs, robot, arm, reach, model)
    fit, candidates = planner.poses()
    targets, left_out = candidates.first(inputs.targets)
    if len(targets) < LEAST_TARGETS:
        raise InputError(_too_few(context, len(targets), left_out))
    from_both = 0.0 if model else inputs.from_both
    counts = Counts(len(fit), len(targets), len(targets) // 2, from_both)
    postures = np.concatenate([fit, targets])
    visits = plan_given_poses(chain, joints, sight, counts, home, pose_seed(context), postures, options)
    rounds = rounds_of(context, visits, home, inputs.monuments_every)
    return TargetPlan(rounds, TargetPlanRow(targets=len(targets), left_out=left_out))


@final
@dataclass(frozen=True, eq=False)
class _Planner:
    context: CellContext
    inputs: PlanTargetsInputs
    robot: RobotFile
    arm: MeasuringArm
    reach: Reach
    model: ModelFile | None

    def poses(self) -> tuple[Floats, _Candidates]:
        """Postures of the fit (F, n), deg, and the candidates for targets."""
        count = self.inputs.registration if self.model else self.inputs.fit
        if not self.inputs.target_file:
            drawn = self._drawn(count + self.inputs.targets)
            names = [f"planned target {number}" for number in range(1, self.inputs.targets + 1)]
            return drawn[:count], self._candidates(drawn[count:], names, [""] * len(names))
        file = Path(self.context.cell.file).parent / self.inputs.target_file
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
        settings = compensation_settings(self.context, self.inputs)
        found = Compensable.of(self.model, readings, settings).reasons
        return _Candidates(readings, names, [ours or theirs for ours, theirs in zip(reasons, found, strict=True)])

    def _drawn(self, count: int) -> Floats:
        with enough_in_reach(self.context):
            return measuring_postures(self.arm, self._inside(), count, pose_seed(self.context))

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
