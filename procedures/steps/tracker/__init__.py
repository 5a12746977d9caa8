"""Campaigns with an instrument that measures reflectors on the robot: the steps of the family `tracker`."""

from procedures.steps.tracker._instrument import check_reflector, monuments, prepare, two_face
from procedures.steps.tracker._locating import frames, locate, plan_turns
from procedures.steps.tracker._proving import (
    compensate,
    correction_off,
    correction_on,
    identify,
    judge,
    judge_correction,
    measure_corrected,
    push,
    read_model,
    register,
    withdraw,
)
from procedures.steps.tracker._warming import warm_up
from procedures.steps.tracker.comparing import compare
from procedures.steps.tracker.comparing_methods import compare_methods
from procedures.steps.tracker.measuring import measure, measure_compensated
from procedures.steps.tracker.posing import plan, plan_targets

__all__ = [
    "check_reflector",
    "compare",
    "compare_methods",
    "compensate",
    "correction_off",
    "correction_on",
    "frames",
    "identify",
    "judge",
    "judge_correction",
    "locate",
    "measure",
    "measure_compensated",
    "measure_corrected",
    "monuments",
    "plan",
    "plan_targets",
    "plan_turns",
    "prepare",
    "push",
    "read_model",
    "register",
    "two_face",
    "warm_up",
    "withdraw",
]
