"""`/api`: what the JSON API offers, from its OpenAPI document."""

from __future__ import annotations

import json
from typing import Any

from fastapi import Request
from nicegui import ui

from cellctl.console.api.described_route import DescribedRoute
from cellctl.console.api.document import SUBJECTS, operations
from cellctl.console.frame import frame
from cellctl.console.look import Cell, command_button, figures, link_button, section, words

_READING = (
    "Reading needs no token. A command needs the token that the console printed at its start, and names the person who "
    "gives it. Each command leaves a line in the audit log. A refused request answers what is wrong and what to do."
)


@ui.page("/api")
def api(request: Request) -> None:
    """Every route: what it does, what it takes, whether it needs the token, and an example."""
    document: dict[str, Any] = request.app.state.openapi()
    address = f"{request.url.scheme}://{request.url.netloc}"
    with frame("JSON API", "/api"):
        ui.label(_READING).classes("prose")
        with ui.element("div").classes("row"):
            link_button("openapi.json", "/api/openapi.json", icon="data_object")
            ui.label("for programs that make a client, and for tests").classes("note")
        for subject, words in SUBJECTS.items():
            found = [place for place, route in operations(document).items() if subject in route["tags"]]
            with section(subject.capitalize(), note=words), ui.element("div").classes("routes"):
                for method, path in found:
                    _route(DescribedRoute.of(document, method, path, address))


def _route(route: DescribedRoute) -> None:
    with ui.element("details").classes("route"):
        with ui.element("summary"):
            ui.label(route.method).classes("method mono")
            ui.label(route.path).classes("path mono")
            ui.label(_plain(route.summary)).classes("what")
            if route.token:
                with ui.element("span").classes("needs-token"):
                    ui.icon("key").props("aria-hidden=true")
                    ui.label("token")
        with ui.element("div").classes("route-body"):
            if route.words.rstrip(".") != route.summary:
                ui.label(_plain(route.words)).classes("prose")
            _inputs(route)
            with ui.element("div").classes("row"):
                ui.label("Answers").classes("note")
                for status, meaning in route.answers:
                    ui.label(f"{status} {meaning[:1].lower()}{meaning[1:].partition(':')[0]}").classes("answer")
            _example(route.example)


def _inputs(route: DescribedRoute) -> None:
    if not route.inputs:
        return
    rows = [
        [_name(one.name), one.where, one.kind + ("" if one.needed else ", optional"), _plain(one.words)]
        for one in route.inputs
    ]
    figures(words("Input", "In", "Type", "Meaning"), rows, label=f"Inputs of {route.method} {route.path}")


def _name(text: str) -> Cell:
    return lambda: ui.label(text).classes("mono")


def _plain(text: str) -> str:
    return text.replace("`", "")


def _example(text: str) -> None:
    with ui.element("div").classes("example"):
        ui.label(text).classes("mono")
        copy = command_button("Copy", lambda: None, icon="content_copy").props('aria-label="Copy the example"')
        # without HTTPS, and not on loopback, a browser has no clipboard: the text is selected as a whole by a click
        copy.on("click", js_handler=f"() => navigator.clipboard?.writeText({json.dumps(text)})")
