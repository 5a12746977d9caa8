"""The page of a cell's commissioning: each step with what was measured, its limit, and who confirmed it."""

from __future__ import annotations

from cellctl.devices.commissioning_record import CellRecord
from cellctl.report._page import template


def commissioning_page(record: CellRecord) -> str:
    """The record as HTML that prints on A4: no script, nothing fetched."""
    return template("commissioning.html").render(record=record)
