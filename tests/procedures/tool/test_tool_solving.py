"""What the tool's steps make of recorded contacts: tool, σ, verdict on held-out ones, and a line for the robot file."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cellctl.files import InputError, load_yaml
from cellctl.formats import RobotFile, artefact_of
from cellctl.kinematics import inverse
from cellctl.procedure import NoInputs
from procedures.steps.tool._measuring import PoseInputs, read_pose, solve_poses, solve_touches
from procedures.steps.tool._solving import planned_touches
from procedures.steps.tool.rows import ToolErrorsRow, ToolTouchRow, ToolVerdict
from tests.helpers.runs import CELL, ROOT
from tests.helpers.steps import CONTACT, Context

ROBOT_FILE = ROOT / "procedures" / "robots" / "kr5_r1400.yaml"
ROBOT = RobotFile.load(ROBOT_FILE)
OFF = np.array([1.2, -0.8, 2.0])
"""From the taught to the true tool, flange frame, mm."""


class Jogged:
    """A robot that an operator moves by hand between two readings."""

    def __init__(self, places: list[tuple[float, ...]]) -> None:
        self._places = iter(places)

    async def joints(self) -> tuple[float, ...]:
        return next(self._places)


def a_context(folder: Path, **fields: Any) -> Any:
    context = Context(run_folder=folder, robot_file=ROBOT_FILE, cell=load_yaml(CELL), **fields)
    context.seed = 1  # type: ignore[attr-defined]
    return context


def true_chain() -> Any:
    tool = ROBOT.chain().tool_now.copy()
    tool[:3, 3] += OFF
    return ROBOT.chain().with_tool(tool)


def joints_at(tips: np.ndarray, near: np.ndarray) -> np.ndarray:
    """Readings (N, 6), deg, of the true robot with its tip at `tips` (N, 3), oriented as at the readings `near`."""
    chain, joints = true_chain(), ROBOT.joint_map()
    poses = chain.forward(joints.model(near))
    poses[:, :3, 3] = tips
    found = inverse(chain, poses, joints.model(near))
    assert found.converged.all()
    return joints.readings(found.q)


def touched(context: Any) -> list[ToolTouchRow]:
    """The planned touches as a robot with another tool than the taught one makes them; 0.02 mm of noise."""
    planned = planned_touches(context, "S1", 8, 4, 4)
    artefact = artefact_of(context.cell, ("artefact",))
    sphere = artefact.sphere("S1")
    assert sphere is not None
    near = np.array([each.start for each in planned])
    away = true_chain().forward(ROBOT.joint_map().model(near))[:, :3, 3] - np.array(sphere.centre)
    reach = sphere.diameter / 2 + artefact.tip_radius + np.random.default_rng(1).normal(0.0, 0.02, (len(near), 1))
    tips = np.array(sphere.centre) + away / np.linalg.norm(away, axis=1, keepdims=True) * reach
    return [
        ToolTouchRow(**{**CONTACT, "number": n, "set": plan.set, "orientation": plan.orientation, "joints": tuple(q)})
        for n, (plan, q) in enumerate(zip(planned, joints_at(tips, near).tolist(), strict=True))
    ]


def poses_at_a_point(context: Any, count: int) -> list[tuple[float, ...]]:
    """Joints with the true tip within 0.02 mm of one point, in `count` orientations."""
    planned = {each.orientation: each.start for each in planned_touches(context, "S1", count + 2, 2, 3)}
    near = np.array([planned[number] for number in range(count)])
    tips = np.array([950.0, -350.0, 270.0]) + np.random.default_rng(2).normal(0.0, 0.02, (count, 3))
    return [tuple(row) for row in joints_at(tips, near).tolist()]


def test_touches_find_the_true_tool_within_sigma_and_prove_it_on_held_out_orientations(tmp_path: Path) -> None:
    context = a_context(tmp_path)
    context.rows += touched(context)
    solved = asyncio.run(solve_touches(context, NoInputs()))
    verdict: ToolVerdict = context.recorded(ToolVerdict)[-1]
    assert solved.verdict == verdict.verdict == "better"
    assert np.abs(np.array(verdict.tool.difference) - OFF).max() < 4 * max(verdict.tool.sigma) < 0.2
    assert (verdict.tool.orientations, verdict.tool.contacts) == (8, 32)
    errors: ToolErrorsRow = context.recorded(ToolErrorsRow)[-1]
    held_out = np.array(errors.held_out)
    assert set(np.array(errors.orientation)[held_out]).isdisjoint(np.array(errors.orientation)[~held_out])
    assert verdict.after is not None
    assert verdict.after.max == pytest.approx(np.abs(np.array(errors.found)[held_out]).max())


def test_the_tool_line_replaces_that_of_the_robot_file(tmp_path: Path) -> None:
    context = a_context(tmp_path)
    context.rows += touched(context)
    solved = asyncio.run(solve_touches(context, NoInputs()))
    line = next(text for text in (tmp_path / "tool.yaml").read_text().splitlines() if text.startswith("tool:"))
    old = next(text for text in ROBOT_FILE.read_text().splitlines() if text.startswith("tool:"))
    (tmp_path / "robot.yaml").write_text(ROBOT_FILE.read_text().replace(old, line))
    tool = RobotFile.load(tmp_path / "robot.yaml").tool
    assert tool.xyz == pytest.approx(solved.tool, abs=1e-3)
    assert (tool.abc, tool.mass) == (ROBOT.tool.abc, ROBOT.tool.mass)


def test_a_taught_tool_that_is_right_is_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(globals(), "OFF", np.zeros(3))
    context = a_context(tmp_path)
    context.rows += touched(context)
    assert asyncio.run(solve_touches(context, NoInputs())).verdict != "better"
    assert "Not for use" in (tmp_path / "tool.yaml").read_text()


def test_poses_at_a_point_find_the_true_tool_and_each_pose_is_judged_by_the_others(tmp_path: Path) -> None:
    context = a_context(tmp_path)
    context.robot = Jogged(poses_at_a_point(context, 6))
    for number in range(6):
        asyncio.run(read_pose(context, PoseInputs(number=number)))
    solved = asyncio.run(solve_poses(context, NoInputs()))
    verdict: ToolVerdict = context.recorded(ToolVerdict)[-1]
    assert solved.verdict == "better"
    assert np.abs(np.array(verdict.tool.difference) - OFF).max() < 4 * max(verdict.tool.sigma) < 0.6
    assert context.recorded(ToolErrorsRow)[-1].held_out == (True,) * 6


def test_a_robot_that_was_not_moved_between_the_poses_finds_no_tool(tmp_path: Path) -> None:
    context = a_context(tmp_path)
    context.robot = Jogged(poses_at_a_point(context, 4)[:1] * 6)
    for number in range(6):
        asyncio.run(read_pose(context, PoseInputs(number=number)))
    with pytest.raises(InputError, match="too much alike"):
        asyncio.run(solve_poses(context, NoInputs()))
