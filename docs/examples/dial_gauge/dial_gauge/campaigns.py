"""The procedures and cells of this package are found by name; the console compares its runs on a page of their own."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cellctl.installed import Campaigns, History


@dataclass(frozen=True)
class Spreads:
    """Name of each run, newest last, and how far its readings spread, mm."""

    runs: dict[str, float]

    def to_json(self) -> dict[str, Any]:
        """For `/api/dial_gauge_mm`."""
        return {"runs": self.runs}


def read_spreads(runs: Path, first: int | None) -> Spreads:
    """The runs of a folder that have readings, the `first` ones or all. A journal that cannot be read is left out."""
    from cellctl.journal import JournalError, fold, read_journal  # who lists procedures does not need it
    from dial_gauge.steps import LengthRow  # as above

    found = {}
    for file in sorted(runs.glob("*/journal.sqlite")):
        with suppress(JournalError):
            if lengths := [row.mm for row in fold(read_journal(file)).recorded(LengthRow)]:
                found[file.parent.name] = max(lengths) - min(lengths)
    return Spreads(dict(list(found.items())[:first]))


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
            read=read_spreads,
            view=view_spreads,
        ),
    ),
)
