"""`/`: the cell view of a console with a cell, else the analysis of a file; and addresses that it does not have."""

from __future__ import annotations

from fastapi import Request
from fastapi.exception_handlers import http_exception_handler
from fastapi.responses import RedirectResponse
from nicegui import Client, app, ui
from starlette.exceptions import HTTPException
from starlette.responses import Response

from cellctl.console.appearance import link_button
from cellctl.console.frame import frame
from cellctl.console.shared import console


@ui.page("/", response_timeout=10.0)
def home(request: Request) -> RedirectResponse:
    """Go to the first page of this console."""
    return RedirectResponse("/cell" if console().settings.cell else "/analyse")


@app.exception_handler(404)
async def not_found(request: Request, error: Exception) -> Response:
    """The address that is not there, and a link to the first page; a missing file of a page stays a plain answer."""
    if request.scope.get("endpoint") not in (None, app) and isinstance(error, HTTPException):
        return await http_exception_handler(request, error)
    with Client(ui.page(""), request=request) as client, frame("There is no such page", ""):
        ui.label(f"This console has no page {request.url.path[:200]}.").props("role=alert")
        with ui.element("div").classes("row"):
            link_button("First page", "/", icon="home")
    return client.build_response(request, 404)
