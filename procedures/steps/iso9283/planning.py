"""The ISO cube in the workspace, the cycles through its five points, and their table, from cell file and model.

The plate with the reflectors faces the instrument, with one orientation at all points.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import final

import numpy as np

from cellctl.devices import table_correction_deg
from cellctl.files import InputError, Problem
from cellctl.formats import ModelFile, RobotFile, TableFile, postures_of, reflectors_of, table_of
from cellctl.kinematics import Bools, Floats, JointMap, SerialChain, inverse, pose
from cellctl.metrology import cube_points
from cellctl.operations.campaign_services import refuse_table
from cellctl.planning import MeasuringArm, Reach
from cellctl.procedure import CellContext, StepContext, StepResult
from procedures.steps.iso9283 import CycleInputs
from procedures.steps.iso9283.rows import CubeRow
from procedures.steps.tracker.circles import APPROACH_DEG, return_pose, rounded, turn_posture
from procedures.steps.tracker.plan_inputs import DEFAULT_METHOD
from procedures.steps.tracker.pose_planning import pose_limits
from procedures.steps.tracker.pose_plans import PosePlan
from procedures.steps.tracker.rows import MODEL_FILE
from procedures.steps.tracker.target_table import Compensable, CompensationSettings

CYCLE = (0, 4, 3, 2, 1)
"""Order of the points in a cycle: P1, P5, P4, P3, P2, as in the standard."""

VARIED = (0, 1, 3)
"""Points of the multi-directional variation: P1, P2, P4."""

APPROACH_MM = 50.0
"""Way of an approach along an axis of the base."""

_RADII, _HEIGHTS = (0.45, 0.55, 0.65, 0.75), (0.2, 0.3, 0.4, 0.55, 0.7)
"""Centres that are tried, as shares of the robot's reach."""
_AZIMUTHS, _ROLLS = np.radians(np.arange(-90.0, 91.0, 15.0)), np.radians(np.arange(0.0, 360.0, 30.0))

_DEG_PER_MM = 0.5
"""A posture at which 1 mm, or 1 mrad, needs more of a joint is too near to a singularity."""


class CubePose(PosePlan):
    """A visit to P1 … P5 (`place`, from 0) in a cycle, from 0. side: as of `IsoPoseRow`."""

    cycle: int
    place: int
    side: int


class CubeRound(StepResult):
    """Poses, followed by the return pose and a visit to the monuments."""

    poses: list[CubePose]
    back: PosePlan


@final
@dataclass(frozen=True, eq=False)
class Cube:
    """centre (3,), edge, points (5, 3): of the first reflector, base frame, mm. readings (5, n): nominal joints, deg.

    sides (5, 3, n): joints from which each point is approached along the base's x, y, z, deg.
    """

    centre: Floats
    edge: float
    points: Floats
    readings: Floats
    sides: Floats


def planned_cube(context: CellContext, edge: float, centre: Floats | None, reflectors: int) -> Cube:
    """The cube about `centre` (3,), mm, or (None) where the joints are nearest to those of the posture `turn`.

    Raises InputError if the robot cannot go to the five points with the reflectors visible.
    """
    search = _Search.of(context, reflectors)
    centres = search.centres() if centre is None else centre[None]
    for place, start in search.starts(centres):
        found = search.cube(place, edge, start)
        if found is not None:
            return found
    where = "nowhere in the workspace" if centre is None else f"not about {', '.join(f'{x:g}' for x in centre)} mm"
    what = f"the five points of a cube of {edge:g} mm can be measured {where}: {reflectors} reflectors visible, clear"
    raise InputError(
        Problem(str(context.cell.file), 0, 0, what, "choose a smaller edge, fewer reflectors, or move the station")
    )


@final
@dataclass(frozen=True, eq=False)
class _Search:
    """chain: of the first reflector. turn (n,): where the search starts, deg."""

    chain: SerialChain
    joints: JointMap
    arm: MeasuringArm
    reach: Reach
    facing: Floats
    station: Floats
    turn: Floats
    home: Floats

    @classmethod
    def of(cls, context: CellContext, reflectors: int) -> _Search:
        robot = RobotFile.load(context.robot_file)
        reach, sight, options = pose_limits(context, reflectors)
        first = reflectors_of(context.cell).on_flange[0]
        home = np.array(postures_of(context.cell, robot, "turn").home)
        chain, joints = robot.chain().with_base(np.eye(4)), robot.joint_map()
        return cls(
            chain.with_tool(pose(np.eye(3), np.array(first.xyz))),
            joints,
            MeasuringArm(chain, joints, sight, home, options),
            reach,
            np.array(first.facing) / np.linalg.norm(first.facing),
            sight.station,
            turn_posture(context),
            home,
        )

    def centres(self) -> Floats:
        """Centres (N, 3), mm, about A1, in front of the instrument's side first."""
        reach = self.chain.reach_mm
        towards = float(np.arctan2(self.station[1], self.station[0]))
        grid = np.array(np.meshgrid(_RADII, towards + _AZIMUTHS, _HEIGHTS, indexing="ij")).reshape(3, -1)
        radius, azimuth, height = grid
        return np.column_stack([reach * radius * np.cos(azimuth), reach * radius * np.sin(azimuth), reach * height])

    def starts(self, centres: Floats) -> Iterator[tuple[Floats, Floats]]:
        """Usable centres with joints (n,), deg, those nearest to `turn` first."""
        places = np.repeat(centres, len(_ROLLS), axis=0)
        turns = np.concatenate([self._towards_station(place) for place in centres])
        goals = np.array([pose(turn, place) for turn, place in zip(turns, places, strict=True)])
        readings, good = self._inverse(goals, np.tile(self.turn, (len(goals), 1)))
        places, readings = places[good], readings[good]
        if not len(readings):
            return
        usable = self.arm.usable(readings)
        places, readings = places[usable], readings[usable]
        for row in np.argsort(np.abs(readings - self.turn).max(axis=1), kind="stable"):
            yield places[row], readings[row]

    def cube(self, centre: Floats, edge: float, start: Floats) -> Cube | None:
        """The cube about `centre` with the orientation of the posture `start` (n,); None if it cannot be measured."""
        turn = self.chain.forward(self.joints.model(start[None]))[0, :3, :3]
        points = cube_points(centre - edge / 2.0, edge)
        readings, good = self._inverse(np.array([pose(turn, point) for point in points]), np.tile(start, (5, 1)))
        if not (good.all() and self.arm.usable(readings).all()):
            return None
        from_sides = points[:, None] - APPROACH_MM * np.eye(3)
        goals = np.array([pose(turn, place) for place in from_sides.reshape(-1, 3)])
        sides, good = self._inverse(goals, np.repeat(readings, 3, axis=0))
        sides = sides.reshape(5, 3, -1)
        if not (good.all() and self._clear(readings, sides)):
            return None
        return Cube(centre, edge, points, readings.round(4), sides.round(4))

    def _clear(self, readings: Floats, sides: Floats) -> bool:
        """Whether all ways between the points are clear of floor and robot."""
        ends = np.concatenate([readings - APPROACH_DEG, sides[list(VARIED)].reshape(-1, readings.shape[1])])
        starts = np.concatenate([self.home[None], readings])
        pairs = [(start, end) for start in starts for end in ends]
        return bool(self.arm.clear_way(*(np.array(each) for each in zip(*pairs, strict=True))).all())

    def _inverse(self, goals: Floats, start: Floats) -> tuple[Floats, Bools]:
        """Readings (N, n), deg, and which (N,) are found, within the limits and away from singularities."""
        found = inverse(self.chain, goals, self.joints.model(start), tolerance_mm=1e-6, tolerance_rad=1e-9)
        readings = self.joints.readings(found.q)
        margin = self.reach.margin + APPROACH_DEG
        low, high = np.array(self.reach.minimum) + margin, np.array(self.reach.maximum) - margin
        inside = ((readings > low) & (readings < high)).all(axis=1)
        jacobian = self.chain.tool_jacobian(found.q) * np.array([1.0] * 3 + [1e3] * 3)[:, None]
        least = np.linalg.svd(jacobian, compute_uv=False)[:, -1]
        regular = np.degrees(1.0) / np.maximum(least, 1e-9) < _DEG_PER_MM
        return readings, np.asarray(found.converged & inside & regular)

    def _towards_station(self, place: Floats) -> Floats:
        """Rotations (R, 3, 3) of the flange with the plate facing the station from `place` (3,), mm."""
        beam = self.station - place
        along = beam / np.linalg.norm(beam)
        first, second = _frame(self.facing), _frame(along)
        cosine, sine = np.cos(_ROLLS), np.sin(_ROLLS)
        rolls = np.zeros((len(_ROLLS), 3, 3))
        rolls[:, 0, 0] = 1.0
        rolls[:, 1, 1] = rolls[:, 2, 2] = cosine
        rolls[:, 1, 2], rolls[:, 2, 1] = -sine, sine
        return np.asarray(second @ rolls @ first.T)


def _frame(along: Floats) -> Floats:
    """A rotation (3, 3) whose first column is the unit vector `along` (3,)."""
    other = np.eye(3)[np.abs(along).argmin()]
    across = np.cross(along, other)
    across /= np.linalg.norm(across)
    return np.column_stack([along, across, np.cross(along, across)])


def cube_rounds(
    context: CellContext, cube: Cube, joints: Floats, wanted: CycleInputs, *, by_table: bool
) -> list[CubeRound]:
    """All cycles at joints (5, n), deg, in rounds of whole cycles; by_table: the joints are of table rows 1 … 5."""
    visits = [
        CubePose(
            number=number,
            kind="cube",
            reflector=reflectors_of(context.cell).on_flange[0].id,
            origin=rounded(joints[place]),
            way=[rounded(begin)],
            joints=rounded(joints[place]),
            direction=np.sign(joints[place] - begin).astype(int).tolist(),
            row=place + 1 if by_table else None,
            cycle=cycle,
            place=place,
            side=side,
        )
        for number, (cycle, place, side, begin) in enumerate(_visits(cube, joints, wanted))
    ]
    each = len(visits) // wanted.cycles
    size = each * max(1, wanted.monuments_every // each)
    return [_round(context, visits[first : first + size], first // size) for first in range(0, len(visits), size)]


def _visits(cube: Cube, joints: Floats, wanted: CycleInputs) -> list[tuple[int, int, int, Floats]]:
    """Cycle, place, side, and where the approach begins (n,), deg."""
    one = [(place, 0, joints[place] - APPROACH_DEG) for place in CYCLE]
    if wanted.directions:
        one += [(place, side + 1, cube.sides[place, side]) for place in VARIED for side in range(3)]
    return [(cycle, *visit) for cycle in range(wanted.cycles) for visit in one]


def _round(context: CellContext, poses: list[CubePose], number: int) -> CubeRound:
    """The poses one after another; the first one from the return pose, over home."""
    home = rounded(postures_of(context.cell, RobotFile.load(context.robot_file), "turn").home)
    first = poses[0].model_copy(update={"origin": rounded(turn_posture(context)), "way": [home, *poses[0].way]})
    others = [after.model_copy(update={"origin": before.joints}) for before, after in pairwise(poses)]
    back = return_pose(context, poses[-1].joints, number)
    return CubeRound(poses=[first, *others], back=back.model_copy(update={"way": [home, *back.way]}))


def planned(context: CellContext, edge: float, centre: str, reflectors: int) -> Cube:
    """The cube; centre: `x, y, z`, mm, or empty. Raises InputError."""
    place = None
    if centre.strip():
        try:
            place = np.array([float(part) for part in centre.split(",")])
        except ValueError:
            place = np.zeros(0)
        if place.shape != (3,) or not np.isfinite(place).all():
            raise InputError(Problem("--set centre", 0, 0, f"'{centre}' is no place", "write x, y, z in mm"))
    return planned_cube(context, edge, place, reflectors)


def cube_row(cube: Cube) -> CubeRow:
    """The row of a cube."""
    return CubeRow(
        centre=tuple(cube.centre.tolist()),
        edge=cube.edge,
        points=tuple(map(tuple, cube.points.tolist())),
        readings=tuple(map(tuple, cube.readings.tolist())),
        sides=tuple(tuple(map(tuple, each)) for each in cube.sides.tolist()),
    )


def cube_of(context: StepContext) -> Cube:
    """The recorded cube."""
    row = context.recorded(CubeRow)[-1]
    return Cube(
        np.array(row.centre), row.edge, *(np.array(each, float) for each in (row.points, row.readings, row.sides))
    )


def compensated(context: StepContext, wanted: CycleInputs) -> tuple[TableFile, list[CubeRound]]:
    """The table of the five points, and the cycles by it. Raises InputError if a point cannot be compensated."""
    model, cube = ModelFile.load(context.artefact(MODEL_FILE)), cube_of(context)
    limit = table_correction_deg(context.cell)
    made = Compensable.of(model, cube.readings, CompensationSettings(DEFAULT_METHOD, None, limit))
    if not made.good.all():
        named = (f"P{place}: {reason}" for place, reason in enumerate(made.reasons, 1) if reason)
        cure = "choose a smaller edge, or another centre"
        file = str(context.run_folder / MODEL_FILE)
        raise InputError(Problem(file, 0, 0, f"cannot compensate {each}", cure) for each in named)
    identity = context.identity("robot")
    table = table_of(
        model,
        made.targets,
        made.found,
        serial=identity.serial,
        simulated=identity.simulated,
        run=context.run_name,
        created=context.calendar,
    )
    robot = RobotFile.load(context.robot_file)
    refuse_table(table, context.run_folder / "table.json", identity, robot, limit)
    return table, cube_rounds(context, cube, np.array([row.compensated for row in table.rows]), wanted, by_table=True)
