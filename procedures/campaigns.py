"""What the campaigns of this package state besides steps, report sections and scene sources (`cellctl.campaigns`)."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from cellctl.installed import Campaigns, History

if TYPE_CHECKING:
    from procedures.steps.daily.history import DailyHistories


def _daily_checks(runs: Path, baseline_runs: int | None) -> DailyHistories:
    from procedures.steps.daily.history import daily_histories  # the steps take long, and who lists runs needs none

    return daily_histories(runs, baseline_runs)


def _daily_view() -> Callable[[DailyHistories], None]:
    from procedures.daily_page import DailyView  # NiceGUI takes a second, and configures itself

    return DailyView()


CAMPAIGNS = Campaigns(
    first="sphere_selfcal",
    checks={"sphere_selfcal": ("probe",), "tracker_calibration": ("tracker", "plc")},
    histories=(
        History(
            name="daily",
            title="Daily checks",
            about="Histories of daily checks with control charts (mm). "
            "baseline_runs: first checks that give the limits.",
            read=_daily_checks,
            view=_daily_view,
        ),
    ),
)
