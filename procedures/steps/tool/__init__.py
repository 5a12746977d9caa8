"""The taught tool by four points: the steps of the family `tool`."""

from procedures.steps.tool.at_point import read_pose, solve_poses
from procedures.steps.tool.on_sphere import plan, solve_touches, touch

__all__ = ["plan", "read_pose", "solve_poses", "solve_touches", "touch"]
