"""`/api`: what the JSON API offers, from its OpenAPI document."""

from __future__ import annotations

from typing import Any

from fastapi import Request
from nicegui import ui

from cellctl.console.frame import frame
from cellctl.console.look import link_button, section


@ui.page("/api")
def api(request: Request) -> None:
    """Every route with method, path and description."""
    document: dict[str, Any] = request.app.state.openapi()
    with frame("JSON API", "/api"):
        ui.label(
            "Reading needs no token. A command needs Authorization: Bearer TOKEN, and names a person in X-Operator."
        )
        link_button("openapi.json", "/api/openapi.json", icon="data_object")
        subjects: dict[str, list[tuple[str, str, dict[str, Any]]]] = {}
        for path, methods in document["paths"].items():
            for method, route in methods.items():
                subjects.setdefault(route.get("tags", ["other"])[0], []).append((method.upper(), path, route))
        for subject, routes in subjects.items():
            with section(subject):
                _routes(routes)


def _routes(routes: list[tuple[str, str, dict[str, Any]]]) -> None:
    with ui.element("table").classes("figures"):
        for method, path, route in routes:
            with ui.element("tr"):
                for text, words in (
                    (method, "words mono"),
                    (path, "words mono"),
                    (route.get("description", ""), "words"),
                ):
                    with ui.element("td").classes(words):
                        ui.label(text)
                with ui.element("td").classes("words"):
                    ui.label("needs the token" if route.get("security") else "")
