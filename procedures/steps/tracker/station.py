"""Where the instrument is: from the cell file, better once axes were turned, anew after it moved."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from cellctl.devices import Vector3
from cellctl.formats import RobotFile
from cellctl.formats.cell_sections import FlangeReflector, reflectors_of, station_of
from cellctl.kinematics import Floats, inverse_pose, pose_from_xyz_abc
from cellctl.procedure import CellContext, StepContext
from procedures.steps.tracker.rows import StationRow

if TYPE_CHECKING:
    from cellctl.kinematics import JointMap, SerialChain

FIRST_SESSION = "1"
"""Name of the first session."""


def rough_station(context: CellContext) -> Floats:
    """The instrument in the robot's base frame (4, 4), mm, by the cell file."""
    station = station_of(context.cell)
    return pose_from_xyz_abc(station.xyz, station.abc)


def base_from_instrument(context: StepContext) -> Floats:
    """The instrument in the robot's base frame (4, 4), mm, as well as it is known now."""
    rows = context.recorded(StationRow)
    return np.array(rows[-1].matrix) if rows else rough_station(context)


def session_now(context: StepContext) -> str:
    """The data set's session of what is measured now."""
    rows = context.recorded(StationRow)
    return rows[-1].session if rows else FIRST_SESSION


def seen_from_instrument(context: StepContext, place: Floats) -> Vector3:
    """A place (3,) of the robot's base frame in the instrument's frame, mm."""
    x, y, z = (inverse_pose(base_from_instrument(context)) @ [*place, 1.0])[:3].tolist()
    return x, y, z


def reflector_called(context: CellContext, name: str) -> FlangeReflector:
    """The robot's reflector of that name, which a plan took from the same cell file."""
    return next(one for one in reflectors_of(context.cell).on_flange if one.id == name)


def reflector_at(context: CellContext, name: str, readings: Floats) -> Floats:
    """Places (N, 3) of a reflector at readings (N, n), deg, by the nominal robot, in its base frame, mm."""
    chain, joints = robot_of(context.robot_file)
    flange = chain.forward_flange(joints.model(readings))
    return np.asarray(flange[:, :3, 3] + flange[:, :3, :3] @ np.array(reflector_called(context, name).xyz))


@lru_cache(maxsize=1)
def robot_of(file: Path) -> tuple[SerialChain, JointMap]:
    """Chain and joint map of a robot file, which does not change in a run."""
    robot = RobotFile.load(file)
    return robot.chain(), robot.joint_map()
