"""Measuring poses in a cell with spheres: the robot's ways and the beam keep clear of them, checked by brute force."""

from __future__ import annotations

from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cellctl.files import load_yaml
from cellctl.formats import RobotFile, artefact_of
from cellctl.formats.cell_sections import reflectors_of, station_of
from procedures.steps.tracker.plan_inputs import PlanInputs
from procedures.steps.tracker.pose_planning import planned_rounds
from procedures.steps.tracker.pose_plans import PosePlan
from tests.helpers.runs import ROOT

ROBOT_FILE = ROOT / "procedures" / "robots" / "kr5_r1400.yaml"
ROBOT = RobotFile.load(ROBOT_FILE)
CELL = load_yaml(ROOT / "procedures" / "cells" / "sphere_tracker_cell.yaml")
SPHERES = np.array([[*sphere.centre, sphere.diameter / 2] for sphere in artefact_of(CELL, ("artefact",)).spheres])
WRIST_MM, SHAFT_MM = 60.0, 8.0


@pytest.fixture(scope="module")
def poses() -> list[PosePlan]:
    context: Any = SimpleNamespace(cell=CELL, robot_file=ROBOT_FILE, seed=3)
    wanted = PlanInputs(fit=40, held_out=40, monuments_every=40, from_both=0.0)
    return [each for part in planned_rounds(context, wanted, None) for each in (*part.poses, part.back)]


def gaps(start: np.ndarray, end: np.ndarray) -> float:
    """Least distance of the lines `start`–`end` (k, 3) from the surface of any sphere, mm, by points on the lines."""
    points = start[:, None] + np.linspace(0.0, 1.0, 60)[:, None] * (end - start)[:, None]
    away = np.linalg.norm(points[:, :, None] - SPHERES[:, :3], axis=-1) - SPHERES[:, 3]
    return float(away.min())


def test_forearm_wrist_and_tool_keep_clear_of_the_spheres_on_every_way(poses: list[PosePlan]) -> None:
    chain, joints = ROBOT.chain(), ROBOT.joint_map()
    nearest = []
    for pose in poses:
        for start, end in pairwise([pose.origin, *pose.way, pose.joints]):
            q = joints.model(np.linspace(start, end, 40))
            frames, tip = chain.frames(q)[..., :3, 3], chain.forward(q)[:, :3, 3]
            nearest.append(gaps(frames[:, 3], frames[:, 4]) - WRIST_MM)
            nearest.append(gaps(frames[:, 4], frames[:, 6]) - WRIST_MM)
            nearest.append(gaps(frames[:, 6], tip) - SHAFT_MM)
    assert min(nearest) > 30.0


def test_the_beam_to_each_pose_passes_the_spheres(poses: list[PosePlan]) -> None:
    flange = ROBOT.chain().forward_flange(ROBOT.joint_map().model(np.array([pose.joints for pose in poses])))
    reflector = flange @ np.array([*reflectors_of(CELL).on_flange[0].xyz, 1.0])
    station = np.tile(station_of(CELL).xyz, (len(poses), 1))
    assert gaps(reflector[:, :3], station) > 30.0


def directions(places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Horizontal and vertical angle of places (k, 3) from the station, rad."""
    x, y, z = (places - np.array(station_of(CELL).xyz)).T
    return np.arctan2(y, x), np.arctan2(z, np.hypot(x, y))


def test_no_nest_is_in_the_search_window_of_a_pose(poses: list[PosePlan]) -> None:
    station = station_of(CELL)
    flange = ROBOT.chain().forward_flange(ROBOT.joint_map().model(np.array([pose.joints for pose in poses])))
    reflector = (flange @ np.array([*reflectors_of(CELL).on_flange[0].xyz, 1.0]))[:, :3]
    window = station.search_mm / np.linalg.norm(reflector - station.xyz, axis=1)
    (hz, v), (nest_hz, nest_v) = directions(reflector), directions(np.array([nest.xyz for nest in station.nests]))
    turn = np.abs((hz[:, None] - nest_hz + np.pi) % (2 * np.pi) - np.pi)
    outside = (turn > window[:, None]) | (np.abs(v[:, None] - nest_v) > window[:, None])
    assert outside.all()
