"""The taught tool by four points: the steps of the family `tool`."""

from cellctl.procedure import StepDescription
from procedures.steps.tool.plan_inputs import PlanInputs, touches_planned

STEPS = (
    StepDescription("tool.plan", "._measuring", "planning touches", PlanInputs, touches_planned),
    StepDescription("tool.touch", "._measuring", "touching the sphere"),
    StepDescription("tool.solve_touches", "._measuring", "solving for the tool"),
    StepDescription("tool.read_pose", "._measuring", "reading the joints"),
    StepDescription("tool.solve_poses", "._measuring", "solving for the tool"),
)
