"""Performance by ISO 9283, measured by a tracker: the steps of the family `iso9283`."""

from procedures.steps.iso9283.judging import evaluate, judge
from procedures.steps.iso9283.measuring import measure
from procedures.steps.iso9283.preparing import compensate, plan, push, read_model, register

__all__ = ["compensate", "evaluate", "judge", "measure", "plan", "push", "read_model", "register"]
