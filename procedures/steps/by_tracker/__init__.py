"""A model judged by a tracker that took no part in its identification: the steps of the family `by_tracker`."""

from cellctl.procedure import StepDescription

STEPS = (
    StepDescription("by_tracker.judge", ".verdict", "judging the model by the tracker"),
    StepDescription("by_tracker.cross_check", ".agreeing", "comparing both calibrations"),
)
