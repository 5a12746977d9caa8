"""Plans of a test by ISO 9283: poses in rounds between visits to the monuments."""

from __future__ import annotations

from cellctl.procedure import StepResult
from procedures.steps.tracker.plans import PosePlan


class CubePose(PosePlan):
    """A visit to P1 … P5 (`place`, from 0) in a cycle, from 0. side: as of `IsoPoseRow`."""

    cycle: int
    place: int
    side: int


class CubeRound(StepResult):
    """Poses, followed by the return pose and a visit to the monuments."""

    poses: list[CubePose]
    back: PosePlan
