"""`/`: the cell view of a console with a cell, else the analysis of a file."""

from __future__ import annotations

from fastapi import Request
from fastapi.responses import RedirectResponse
from nicegui import ui

from cellctl.console.shared import console


@ui.page("/", response_timeout=10.0)
def home(request: Request) -> RedirectResponse:
    """Go to the first page of this console."""
    return RedirectResponse("/cell" if console().settings.cell else "/analyse")
