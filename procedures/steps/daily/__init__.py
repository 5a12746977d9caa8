"""The daily check of a robot by a tracker: the steps of the family `daily`."""

from cellctl.procedure import StepDescription

STEPS = (
    StepDescription("daily.collect", "._checking", "collecting the points"),
    StepDescription("daily.earlier_runs", "._checking", "reading earlier runs"),
    StepDescription("daily.judge", "._checking", "judging the robot"),
)
