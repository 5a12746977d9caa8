"""Measuring poses of the cell's robot as plans of the steps that move."""

from __future__ import annotations

from dataclasses import replace
from hashlib import sha256
from pathlib import Path
from typing import Protocol

import numpy as np

from cellctl.files import InputError
from cellctl.formats import RobotFile, postures_of
from cellctl.formats.cell_sections import floor_of, reflectors_of, station_of
from cellctl.kinematics import Floats
from cellctl.planning import OutOfReach
from cellctl.planning.measuring_poses import (
    Counts,
    MeasuringArm,
    MeasuringPoses,
    PoseOptions,
    Sight,
    plan_given_poses,
    plan_measuring_poses,
)
from cellctl.planning.ways import Reach
from cellctl.procedure import CellContext
from procedures.steps.sphere.planning import spheres_around
from procedures.steps.tracker.given_poses import GivenPoses
from procedures.steps.tracker.plans import PosePlan, Round
from procedures.steps.tracker.station import rough_station
from procedures.steps.tracker.turn_planning import return_pose, rounded, turn_posture

_MARGIN_DEG = 3.0
"""Margin of the reflector's acceptance, and of the joint limits."""

_NEAREST_MM = 1600.0
"""Least distance from the instrument: laser stations measure from 1.5 m."""

_WIDEST_DEG = 180.0
"""No joint is turned farther from 0 than this: more turns show nothing new, and twist the cables."""


class Wanted(Protocol):
    """The procedure's settings."""

    @property
    def fit(self) -> int:
        """Poses to identify from."""

    @property
    def held_out(self) -> int:
        """Poses that judge."""

    @property
    def monuments_every(self) -> int:
        """Poses between two visits to the monuments."""

    @property
    def from_both(self) -> float:
        """Share of the fit's poses measured from both sides."""

    @property
    def reflectors(self) -> int:
        """How many reflectors of the plate must be visible."""

    @property
    def pose_file(self) -> str:
        """File of the poses, from the cell file's folder; empty: they are planned."""


def planned_rounds(context: CellContext, wanted: Wanted, station: Floats | None) -> list[Round]:
    """The poses in rounds of `monuments_every`; station (4, 4): the instrument in the base frame, None: the cell
    file's. Raises InputError if too few poses can be measured.
    """
    robot = RobotFile.load(context.robot_file)
    home = np.array(postures_of(context.cell, robot, "turn").home)
    return rounds_of(context, _poses(context, robot, wanted, station, home), home, wanted.monuments_every)


def rounds_of(context: CellContext, poses: MeasuringPoses, home: Floats, monuments_every: int) -> list[Round]:
    """Visits in rounds of `monuments_every`, each from the return pose and back to it; home (n,), deg."""
    plans = _plans(context, poses, home)
    rounds = [plans[first : first + monuments_every] for first in range(0, len(plans), monuments_every)]
    return [
        Round(poses=_from_return_pose(context, each, home), back=_back(context, each, home, len(plans) + number))
        for number, each in enumerate(rounds)
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


def pose_seed(context: CellContext) -> int:
    """Of the poses that are drawn in a run."""
    return int.from_bytes(sha256(f"{context.seed}/poses".encode()).digest()[:4])


def _poses(
    context: CellContext, robot: RobotFile, wanted: Wanted, station: Floats | None, home: Floats
) -> MeasuringPoses:
    reach, sight, options = pose_limits(context, wanted.reflectors, station)
    counts = Counts(wanted.fit, wanted.held_out, wanted.held_out // 2, wanted.from_both)
    seed = pose_seed(context)
    chain, joints = robot.chain(), robot.joint_map()
    if wanted.pose_file:
        file = Path(context.cell.file).parent / wanted.pose_file
        arm = MeasuringArm(chain.with_base(np.eye(4)), joints, sight, home, options)
        postures = GivenPoses.read(file, robot, arm, reach).first(wanted.fit, wanted.held_out)
        return plan_given_poses(chain, joints, sight, counts, home, seed, postures, options)
    try:
        return plan_measuring_poses(chain, joints, reach, sight, counts, home, seed, options)
    except OutOfReach as error:
        cure = "move the station, turn the reflector on the flange, or ask for fewer poses"
        raise InputError(context.cell.problem(("reflectors", "on_flange"), str(error), cure)) from error


def _plans(context: CellContext, poses: MeasuringPoses, home: Floats) -> list[PosePlan]:
    name = reflectors_of(context.cell).on_flange[0].id
    plans = []
    for number in range(len(poses)):
        origin = poses.readings[number - 1] if number else home
        over = [rounded(home)] if poses.over_home[number] else []
        plans.append(
            PosePlan(
                number=number,
                kind="test" if poses.held_out[number] else "fit",
                reflector=name,
                origin=rounded(origin),
                way=[*over, rounded(poses.approach[number])],
                joints=rounded(poses.readings[number]),
                direction=poses.side[number].tolist(),
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
