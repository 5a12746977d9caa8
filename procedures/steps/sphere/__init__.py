"""The campaign that touches spheres: the steps of the family `sphere`."""

from cellctl.procedure import StepDescription
from procedures.steps.sphere.plan_inputs import (
    CompensateInputs,
    PlanInputs,
    PlanProofInputs,
    standoffs_planned,
    touches_located,
    touches_planned,
)

STEPS = (
    StepDescription("sphere.plan", ".touching", "planning touches", PlanInputs, touches_planned),
    StepDescription("sphere.next_batch", ".batches", "planning the next touches"),
    StepDescription("sphere.touch", ".touching", "touching spheres"),
    StepDescription("sphere.identify", ".touching", "identifying the robot"),
    StepDescription("sphere.convergence", ".converging", "following the identification"),
    StepDescription("sphere.plan_proof", "._proving", "planning the proof", PlanProofInputs, touches_located),
    StepDescription("sphere.compensate", "._proving", "compensating targets", CompensateInputs, standoffs_planned),
    StepDescription("sphere.push", "._proving", "pushing the table"),
    StepDescription("sphere.standoff", "._proving", "measuring stand-offs"),
    StepDescription("sphere.judge", "._proving", "judging the table"),
    StepDescription("sphere.withdraw", "._proving"),
)
