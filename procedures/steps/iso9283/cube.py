"""The ISO cube in the workspace: where it is, and the joints for its five points.

The plate with the reflectors faces the instrument, with one orientation at all points.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import final

import numpy as np

from cellctl.files import InputError, Problem
from cellctl.formats import RobotFile, postures_of
from cellctl.formats.cell_sections import reflectors_of
from cellctl.kinematics import Bools, Floats, JointMap, SerialChain, inverse, pose
from cellctl.metrology.iso9283 import cube_points
from cellctl.planning.measuring_poses import MeasuringArm
from cellctl.planning.ways import Reach
from cellctl.procedure import CellContext
from procedures.steps.tracker.pose_planning import pose_limits
from procedures.steps.tracker.turn_planning import APPROACH_DEG, turn_posture

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
