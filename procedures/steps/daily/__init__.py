"""The daily check of a robot by a tracker: the steps of the family `daily`."""

from procedures.steps.daily._checking import collect, earlier_runs, judge

__all__ = ["collect", "earlier_runs", "judge"]
