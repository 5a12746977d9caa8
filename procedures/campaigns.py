"""What the campaigns of this package state besides steps, report sections and scene sources (`cellctl.campaigns`)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from cellctl.installed import Campaigns, History
from cellctl.journal import RunState

if TYPE_CHECKING:
    from procedures.steps.daily.history import DailyHistory


def _daily_entry(state: RunState) -> tuple[str, str, dict[str, Any]] | None:
    if "daily" not in state.section:
        return None
    from procedures.steps.daily.history import daily_entry  # the steps take long, and who lists runs needs none

    return daily_entry(state)


def _daily_checks(found: Sequence[tuple[str, Mapping[str, Any]]], baseline_runs: int | None) -> DailyHistory:
    from procedures.steps.daily.history import compared_checks  # as above

    return compared_checks(found, baseline_runs)


def _daily_view() -> Callable[[DailyHistory], None]:
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
            entry=_daily_entry,
            compare=_daily_checks,
            view=_daily_view,
        ),
    ),
)
