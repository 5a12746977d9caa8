"""The rows of a daily check. Joints in degrees, lengths in mm; docs/reference/run-folder.md."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, final

from cellctl.records import Row, VerdictRow

Matrix = tuple[tuple[float, ...], ...]


@final
@dataclass(frozen=True, kw_only=True)
class DayPoints:
    """The points of one run. baseline: its name. robot: serial of the controller. payload_kg: of the load.

    commanded (P, n): joints of the points. points (P, 3), nests (N, 3): measured, in the instrument's frame; nest_names
    (N,). spread (N, 3, 3): covariance of the nests, mm², without the part that all points share.
    """

    baseline: str
    robot: str
    payload_kg: float
    accuracy: str
    commanded: Matrix
    points: Matrix
    nest_names: tuple[str, ...]
    nests: Matrix
    spread: tuple[Matrix, ...]

    def same_check(self, other: DayPoints) -> str:
        """Why `other` cannot be compared with this run; empty if it can."""
        names = {
            "another controller": "robot",
            "another load": "payload_kg",
            "another accuracy profile of the instrument": "accuracy",
            "other points": "commanded",
            "other nests": "nest_names",
        }
        return next((why for why, name in names.items() if getattr(self, name) != getattr(other, name)), "")


@final
@dataclass(frozen=True, kw_only=True)
class DailyPointsRow(Row):
    """What this run measured."""

    KIND: ClassVar[str] = "daily points"
    day: DayPoints


@final
@dataclass(frozen=True, kw_only=True)
class EarlierRun:
    """An earlier run of the same check: its name, when it began (ISO 8601), what it measured."""

    run: str
    began: str
    day: DayPoints


@final
@dataclass(frozen=True, kw_only=True)
class EarlierRunsRow(Row):
    """What was read from the folder of runs: the earlier runs of this check, oldest first.

    left_out: name of a run, and why it cannot be compared.
    """

    KIND: ClassVar[str] = "earlier runs"
    runs: tuple[EarlierRun, ...]
    left_out: tuple[tuple[str, str], ...]


@final
@dataclass(frozen=True, kw_only=True)
class ControlChartRow(Row):
    """The control charts over the R runs since the baseline. began (R,): ISO 8601. t2, ewma (R,), with their limits.

    features: names; deviations (R, k): of each run from the baseline's mean, in standard deviations. verdict (R,).
    """

    KIND: ClassVar[str] = "control chart"
    began: tuple[str, ...]
    t2: tuple[float, ...]
    t2_limit: float
    ewma: tuple[float, ...]
    ewma_limit: float
    features: tuple[str, ...]
    deviations: Matrix
    verdict: tuple[str, ...]


@final
@dataclass(frozen=True, kw_only=True)
class DailyFigures:
    """Figures of the last run. baseline: its name; baseline_runs of the `baseline_needed`; since: runs judged so far.

    false_alarm: probability per run and chart that a robot without a change is reported. reason: of the verdict.
    """

    baseline: str
    baseline_runs: int
    baseline_needed: int
    since: int
    left_out: int
    false_alarm: float
    reason: str
    t2: float | None = None
    t2_limit: float | None = None
    ewma: float | None = None
    ewma_limit: float | None = None


@final
@dataclass(frozen=True, kw_only=True)
class DailyVerdict(VerdictRow):
    """Verdict of a daily check: `baseline`, `in control`, `measure again` or `recalibrate`.

    The first two end with exit code 0.
    """

    SECTION: ClassVar[tuple[str, ...]] = ("daily", "accuracy", "noise_only")
    daily: DailyFigures
    accuracy: str
    noise_only: bool
