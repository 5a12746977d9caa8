"""The procedures and cells of this package are found by name; the console compares its runs on a page of their own."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from cellctl.installed import Campaigns, History
from cellctl.journal import RunState


@dataclass(frozen=True)
class Spreads:
    """Name of each run, newest last, and how far its readings spread, mm."""

    runs: dict[str, float]

    def to_json(self) -> dict[str, Any]:
        """For `/api/dial_gauge_mm`."""
        return {"runs": self.runs}


def spread_of(state: RunState) -> tuple[str, str, dict[str, float]] | None:
    """The series of a finished run, its title, and what is compared; None for a run without readings."""
    from dial_gauge.steps import LengthRow  # who lists procedures does not need it

    lengths = [row.mm for row in state.recorded(LengthRow)]
    return ("all", "All runs", {"mm": max(lengths) - min(lengths)}) if lengths else None


def compare_spreads(found: Sequence[tuple[str, Mapping[str, Any]]], first: int | None) -> Spreads:
    """The runs of a series, the `first` ones or all."""
    return Spreads({run: content["mm"] for run, content in found[:first]})


def view_spreads() -> Callable[[Spreads], None]:
    """The content of the page."""
    from nicegui import ui  # it takes a second, and configures itself

    columns = [{"name": name, "label": name, "field": name} for name in ("run", "mm")]
    table = ui.table(columns=columns, rows=[])

    def show(found: Spreads) -> None:
        table.rows = [{"run": run, "mm": f"{mm:.3f}"} for run, mm in found.runs.items()]

    return show


CAMPAIGNS = Campaigns(
    first="dial_gauge_drift",
    histories=(
        History(
            name="dial_gauge_mm",
            title="Dial gauge",
            about="Spread of the readings of each run, mm.",
            entry=spread_of,
            compare=compare_spreads,
            view=view_spreads,
        ),
    ),
)
