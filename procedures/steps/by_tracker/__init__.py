"""A model judged by a tracker that took no part in its identification: the steps of the family `by_tracker`."""

from procedures.steps.by_tracker.verdict import judge

__all__ = ["judge"]
