"""Campaigns with an instrument that measures reflectors on the robot: the steps of the family `tracker`."""

from cellctl.procedure import StepDescription
from procedures.steps.tracker.plan_inputs import (
    PlanInputs,
    PlanTargetsInputs,
    TurnInputs,
    poses_planned,
    targets_planned,
    turns_planned,
)

STEPS = (
    StepDescription("tracker.prepare", "._instrument", "preparing the instrument"),
    StepDescription("tracker.two_face", "._instrument", "two-face check"),
    StepDescription("tracker.monuments", "._instrument", "visiting the monuments"),
    StepDescription("tracker.check_reflector", "._instrument", "checking the reflector constant"),
    StepDescription("tracker.warm_up", "._warming", "warming up"),
    StepDescription("tracker.locate", "._locating", "locating the instrument"),
    StepDescription("tracker.plan_turns", "._locating", "planning the circles", TurnInputs, turns_planned),
    StepDescription("tracker.frames", "._locating", "finding the frames"),
    StepDescription("tracker.plan", ".posing", "planning poses", PlanInputs, poses_planned),
    StepDescription("tracker.next_round", ".batches", "planning the next poses"),
    StepDescription("tracker.plan_targets", ".posing", "planning the targets", PlanTargetsInputs, targets_planned),
    StepDescription("tracker.measure", ".measuring", "measuring poses"),
    StepDescription("tracker.measure_compensated", ".measuring", "measuring compensated targets"),
    StepDescription("tracker.compare", ".comparing", "comparing models"),
    StepDescription("tracker.identify", "._proving", "identifying the robot"),
    StepDescription("tracker.read_model", "._proving", "reading the model"),
    StepDescription("tracker.register", "._proving", "registering the model"),
    StepDescription("tracker.compensate", "._proving", "compensating targets"),
    StepDescription("tracker.compare_methods", ".comparing_methods", "comparing methods of compensation"),
    StepDescription("tracker.push", "._proving", "pushing the table"),
    StepDescription("tracker.judge", "._proving", "judging the table"),
    StepDescription("tracker.withdraw", "._proving"),
    StepDescription("tracker.correction_on", "._proving", "switching the on-line correction on"),
    StepDescription("tracker.measure_corrected", "._proving", "measuring corrected targets"),
    StepDescription("tracker.correction_off", "._proving", "switching the on-line correction off"),
    StepDescription("tracker.judge_correction", "._proving", "judging the on-line correction"),
)
