"""The OpenAPI document: each route's summary is the first sentence of its description."""

from __future__ import annotations

from typing import Any

from fastapi import FastAPI
from fastapi.routing import APIRoute

SUBJECTS = {
    "console": "The console itself, and its audit log",
    "cells": "Cells and the health of their devices",
    "start": "Procedures, the check, and the start of a run",
    "run": "One run in progress, and the commands that act on it",
    "runs": "Finished and running runs: list, figures, files, comparison, drift, daily checks",
    "tables": "Compensation tables of the controllers",
    "analyses": "Fits of data files without a cell",
}
"""Tag of a route → what its routes are about."""

TAGS = [{"name": name, "description": words} for name, words in SUBJECTS.items()]


def unique_id(route: APIRoute) -> str:
    """The id of a route for generated clients: `run_pause`."""
    return f"{route.tags[0]}_{route.name}"


def summarise(app: FastAPI) -> None:
    """Let the document of `app` have readable summaries."""
    made = app.openapi

    def document() -> dict[str, Any]:
        if not app.openapi_schema:
            for route in operations(made()).values():
                route["summary"] = first_sentence(route.get("description", ""))
                for answer in route["responses"].values():
                    answer["description"] = answer["description"].replace("Successful Response", "Done")
        return made()

    app.openapi = document  # type: ignore[method-assign]


def operations(document: dict[str, Any]) -> dict[tuple[str, str], dict[str, Any]]:
    """The operations of a document by method (`GET`) and path."""
    paths = document["paths"].items()
    return {(method.upper(), path): route for path, methods in paths for method, route in methods.items()}


def first_sentence(text: str) -> str:
    """`text` up to its first end of a sentence, without the full stop."""
    return " ".join(text.split()).partition(". ")[0].rstrip(".")
