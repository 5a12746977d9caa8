"""`/api`: what the JSON API offers, from its OpenAPI document: each route with inputs and an example with curl."""

from __future__ import annotations

import json
import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Self, final

from fastapi import Request
from nicegui import ui

from cellctl.console.api.answers import SUBJECTS, operations
from cellctl.console.appearance import Cell, command_button, figures, link_button, section, words
from cellctl.console.frame import frame

_FORM, _JSON = "multipart/form-data", "application/json"


@final
@dataclass(frozen=True, slots=True)
class Input:
    """What a route takes. `where`: path, query, header, form or JSON; `kind`: type; `needed`: it has no default."""

    name: str
    where: str
    kind: str
    words: str
    needed: bool


@final
@dataclass(frozen=True, slots=True)
class DescribedRoute:
    """A route of the API. `token`: it is a command. `answers`: status and meaning. `example`: a line for a shell."""

    method: str
    path: str
    summary: str
    words: str
    token: bool
    inputs: tuple[Input, ...]
    answers: tuple[tuple[str, str], ...]
    example: str

    @classmethod
    def of(cls, document: dict[str, Any], method: str, path: str, address: str) -> Self:
        """The route of `document`. address: of the console, `http://127.0.0.1:8090`."""
        route = document["paths"][path][method.lower()]
        inputs = tuple(_inputs_of(document, route))
        answers = tuple((status, answer["description"]) for status, answer in sorted(route["responses"].items()))
        words = " ".join(route.get("description", "").split())
        token = bool(route.get("security"))
        example = _curl(f"{address}{path}", method, inputs, token=token)
        return cls(method, path, route["summary"], words, token, inputs, answers, example)


def _inputs_of(document: dict[str, Any], route: dict[str, Any]) -> Iterator[Input]:
    for one in route.get("parameters", ()):
        needed = one.get("required", False)
        yield Input(one["name"], one["in"], _kind(document, one["schema"]), one.get("description", ""), needed)
    for media, content in route.get("requestBody", {}).get("content", {}).items():
        schema = _resolved(document, content["schema"])
        for name, one in schema.get("properties", {}).items():
            where = "form" if media == _FORM else "JSON"
            needed = name in schema.get("required", ())
            yield Input(name, where, _kind(document, one), one.get("description", ""), needed)


def _resolved(document: dict[str, Any], schema: dict[str, Any]) -> dict[str, Any]:
    name = schema.get("$ref", "").rpartition("/")[2]
    found: dict[str, Any] = document["components"]["schemas"][name] if name else schema
    return found


def _kind(document: dict[str, Any], schema: dict[str, Any]) -> str:
    """A type in a word: `integer`, `file`, `text or null`, `csv | zip`."""
    schema = _resolved(document, schema)
    if "anyOf" in schema:
        return " or ".join(_kind(document, one) for one in schema["anyOf"])
    if "enum" in schema:
        return " | ".join(map(str, schema["enum"]))
    if "contentMediaType" in schema or schema.get("format") == "binary":
        return "file"
    if schema.get("type") == "array":
        return f"{_kind(document, schema.get('items', {}))}s"
    plain = str(schema.get("type", "any"))
    return {"string": "text", "boolean": "true | false"}.get(plain, plain)


def _curl(url: str, method: str, inputs: tuple[Input, ...], *, token: bool) -> str:
    """A request with the inputs that have no default; capitals stand for a value."""
    for one in inputs:
        url = url.replace(f"{{{one.name}}}", one.name.upper())
    needed = [one for one in inputs if one.needed]
    query = "&".join(f"{one.name}={_value(one)}" for one in needed if one.where == "query")
    implied = method == "GET" or any(one.where in ("form", "JSON") for one in inputs if one.needed)
    words = ["curl", *([] if implied else ["-X", method]), f"{url}{'?' if query else ''}{query}"]
    if token:
        words += ["-H", "Authorization: Bearer TOKEN", "-H", "X-Operator: YOUR NAME"]
    words += [word for one in needed if one.where == "form" for word in ("-F", f"{one.name}={_value(one)}")]
    if any(one.where == "JSON" for one in inputs):
        words += ["--json", json.dumps({one.name: _value(one) for one in needed if one.where == "JSON"})]
    return shlex.join(words)


def _value(one: Input) -> str:
    if one.kind in ("file", "files"):
        return f"@{one.name.upper()}"
    return one.kind.partition(" | ")[0] if " | " in one.kind else one.name.upper()


_READING = (
    "Reading needs no token. A command needs the token that the console printed at its start, and names the person who "
    "gives it. Where the console has named users, both need the token of a user. Each command leaves a line in the "
    "audit log. A refused request answers what is wrong and what to do."
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
