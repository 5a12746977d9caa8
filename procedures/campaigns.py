"""What the campaigns of this package state besides steps, report sections and scene sources (`cellctl.campaigns`)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from types import ModuleType
from typing import TYPE_CHECKING, Any

from cellctl.installed import Campaigns, History
from cellctl.journal import RunState

if TYPE_CHECKING:
    from procedures.steps.daily.history import DailyHistory


def _daily_history() -> ModuleType:
    from procedures.steps.daily import history  # the steps take long, and who lists runs needs none

    return history


def _daily_entry(state: RunState) -> tuple[str, str, dict[str, Any]] | None:
    found: tuple[str, str, dict[str, Any]] | None = None
    if "daily" in state.section:
        found = _daily_history().daily_entry(state)
    return found


def _daily_checks(found: Sequence[tuple[str, Mapping[str, Any]]], baseline_runs: int | None) -> DailyHistory:
    compared: DailyHistory = _daily_history().compared_checks(found, baseline_runs)
    return compared


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
