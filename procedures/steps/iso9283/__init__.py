"""Performance by ISO 9283, measured by a tracker: the steps of the family `iso9283`."""

from procedures.steps.iso9283._measuring import compensate, evaluate, judge, measure, plan, push, read_model, register

__all__ = ["compensate", "evaluate", "judge", "measure", "plan", "push", "read_model", "register"]
