"""Performance by ISO 9283, measured by a tracker: the steps of the family `iso9283`."""

from cellctl.procedure import StepDescription
from procedures.steps.iso9283.plan_inputs import CycleInputs, PlanInputs, visits_planned

STEPS = (
    StepDescription("iso9283.read_model", "._measuring", "reading the model"),
    StepDescription("iso9283.plan", "._measuring", "planning the cube", PlanInputs, visits_planned),
    StepDescription("iso9283.compensate", "._measuring", "compensating the five points", CycleInputs, visits_planned),
    StepDescription("iso9283.register", "._measuring", "registering the base frame"),
    StepDescription("iso9283.push", "._measuring", "pushing the table"),
    StepDescription("iso9283.measure", "._measuring", "measuring the five points"),
    StepDescription("iso9283.evaluate", "._measuring", "computing the figures"),
    StepDescription("iso9283.judge", "._measuring", "judging the table"),
)
