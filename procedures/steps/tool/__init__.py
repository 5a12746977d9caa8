"""The taught tool by four points: the steps of the family `tool`."""

from procedures.steps.tool._measuring import plan, read_pose, solve_poses, solve_touches, touch

__all__ = ["plan", "read_pose", "solve_poses", "solve_touches", "touch"]
