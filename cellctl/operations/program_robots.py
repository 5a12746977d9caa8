"""The two robots behind a program: the nominal one that its controller computes with, and the identified one.

Both are in the robot's base frame (ROBROOT), where a program's poses are: the identified base is put on it, so that no
instrument's frame is left. The tool of a point is the controller's data for it. The identified robot carries the tool
that the model identified, if the program's tool data are the model's; with `arm_only` it carries the program's.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import final

import numpy as np

from cellctl.calibration import RobotModel
from cellctl.formats import ModelFile
from cellctl.kinematics import Floats, SerialChain, pose_from_xyz_abc, rotation_vector
from cellctl.operations.program_motions import Frame, Numbers

SAME_TOOL_MM, SAME_TOOL_DEG = 0.01, 0.01
"""Largest difference of two statements of one tool: files round."""

IDENTIFIED_TOOL_MM, IDENTIFIED_TOOL_DEG = 10.0, 3.0
"""A fit's tool that is further from the robot file's is another thing: a reflector, for instance."""


@final
@dataclass(frozen=True, eq=False)
class Robots:
    """nominal: as its controller has it, with the tool data of the point. identified: with the tool that it carries."""

    nominal: SerialChain
    identified: RobotModel


@final
@dataclass(frozen=True, eq=False)
class ProgramRobots:
    """The robots of a model by the tool of a point."""

    model: ModelFile
    arm_only: bool = False

    @property
    def tool_shift_mm(self) -> float:
        """Distance of the identified tool from the robot file's, in the flange frame."""
        return _apart(self.model.robot_model().chain.tool_now, self.model.robot.chain().tool)[0]

    def of(self, tool: Frame) -> Robots | str:
        """The robots for points with `tool`, or why its points cannot be compensated."""
        assert tool.numbers is not None
        taught, robot = _pose(tool.numbers), self.model.robot.chain().with_base(np.eye(4))
        found = self.model.robot_model()
        if self.arm_only:
            return Robots(robot.with_tool(taught), found.on(np.eye(4), taught))
        reason = _other_tool(tool, taught, robot.tool, found.chain.tool_now)
        identified = replace(found, chain=found.chain.with_base(np.eye(4)))
        return reason or Robots(robot.with_tool(taught), identified)


def _other_tool(tool: Frame, taught: Floats, in_file: Floats, identified: Floats) -> str:
    away, turned = _apart(taught, in_file)
    if away > SAME_TOOL_MM or turned > SAME_TOOL_DEG:
        what = f"wrong tool: {tool.name} is {away:.2f} mm and {turned:.2f}° from the tool of the model's robot file"
        return f"{what}; the tool was changed after the model, or is another one (--arm-only corrects the arm alone)"
    away, turned = _apart(identified, in_file)
    if away > IDENTIFIED_TOOL_MM or turned > IDENTIFIED_TOOL_DEG:
        what = f"wrong tool: the model was identified with a tool {away:.0f} mm and {turned:.0f}° from {tool.name}"
        return f"{what}, perhaps a reflector (--arm-only corrects the arm alone)"
    return ""


def _apart(one: Floats, other: Floats) -> tuple[float, float]:
    """Distance, mm, and angle, deg, of two poses."""
    turn = rotation_vector(one[:3, :3] @ other[:3, :3].T)
    return float(np.linalg.norm(one[:3, 3] - other[:3, 3])), float(np.rad2deg(np.linalg.norm(turn)))


def _pose(numbers: Numbers) -> Floats:
    return pose_from_xyz_abc(numbers[:3], numbers[3:])
