"""What all routes of the API share: the operator of a command, errors as JSON, and the OpenAPI document."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Annotated, Any, Self

from fastapi import Depends, FastAPI, Header, Path, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from fastapi.routing import APIRoute
from fastapi.security import HTTPAuthorizationCredentials, HTTPBearer
from pydantic import BaseModel, Field
from starlette.exceptions import HTTPException
from starlette.routing import compile_path

from cellctl.console.access import ROUTES, NotAllowed
from cellctl.console.guarding import NO_TOKEN, NO_USER
from cellctl.console.shared import console
from cellctl.devices import DeviceError
from cellctl.engine import Operator
from cellctl.files import InputError, Problem
from cellctl.installed import histories
from cellctl.journal import JournalError
from cellctl.operations.results import Failure

_COMPARED = ", ".join(each.title.lower() for each in histories())

SUBJECTS = {
    "console": "The console itself, and its audit log",
    "cells": "Cells and the health of their devices",
    "attention": "Events as they happen, and alarms",
    "start": "Procedures, the check, and the start of a run",
    "queue": "Runs that wait for their cell or their time, schedules, and offers to confirm",
    "run": "One run in progress, and the commands that act on it",
    "runs": "Finished and running runs: list, figures, files, comparison, drift, " + _COMPARED,
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


class ProblemOut(BaseModel):
    """One error: its place, what is wrong, what to do. `line` and `column` from 1; 0: the whole file."""

    file: str = Field(description="File, parameter or field")
    line: int = 0
    column: int = 0
    what: str = Field(description="What is wrong")
    cure: str = Field(default="", description="What to do")

    @classmethod
    def of(cls, problem: Problem, **more: Any) -> Self:
        """A problem for JSON; more: the fields of a class derived from this one."""
        return cls(**asdict(problem), **more)


class Refusal(BaseModel):
    """Why a request was refused; nothing was done."""

    what: str
    cure: str = ""
    problems: list[ProblemOut] = []


class Refused(Exception):
    """A request that cannot be carried out: HTTP status, what is wrong, what to do."""

    def __init__(self, status: int, what: str, cure: str = "") -> None:
        self.status, self.what, self.cure = status, what, cure
        super().__init__(what)


_bearer = HTTPBearer(auto_error=False, description="The token that the console printed, or a user's.")


async def _operator(
    request: Request,
    token: Annotated[HTTPAuthorizationCredentials | None, Depends(_bearer)],
    x_operator: Annotated[str, Header(description="Who gives the command; with named users, the token says that")] = "",
) -> Operator:
    sessions = console().sessions
    operator = sessions.of_program(token.credentials, _decoded(x_operator)) if token else None
    if operator is None:
        raise Refused(401, NO_USER if sessions.users else NO_TOKEN, "send `Authorization: Bearer TOKEN`")
    command = ROUTES.get(f"{request.method} {request.scope['route'].path}", "")
    if sessions.why_not(operator, command):
        await console().command(operator, command, request.url.path, _nothing)  # it is recorded, and refused
    return operator


async def _nothing() -> None: ...


def _decoded(header: str) -> str:
    """A header's text: programs send UTF-8, HTTP reads Latin-1."""
    try:
        return header.encode("latin-1").decode("utf-8")
    except UnicodeError:
        return header


Commander = Annotated[Operator, Depends(_operator)]
"""The operator who gives a command: a route with this argument needs the token."""

_METHODS = ("GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS")
_WORDS = {
    401: "No token, or a wrong one",
    403: "The user's role does not cover this",
    404: "No such thing",
    409: "Not possible now",
    413: "Upload too large",
    422: "The content is wrong: each problem with its place and cure",
}


def _failures(*statuses: int) -> dict[int | str, dict[str, Any]]:
    return {status: {"model": Refusal, "description": _WORDS[status]} for status in statuses}


INVALID = _failures(422)
"""`responses=` of every route."""
READS = _failures(404, 409, 422)
"""`responses=` of a route that reads."""
COMMANDS = _failures(*_WORDS)
"""`responses=` of a route that commands."""


RunName = Annotated[str, Path(description="Name of the run, see `GET /api/runs`")]
AnalysisName = Annotated[str, Path(description="Name of the analysis, see `GET /api/analyses`")]
CellName = Annotated[str, Path(description="Name of the cell, see `GET /api/cells`")]
ProcedureName = Annotated[str, Path(description="Name of the procedure, see `GET /api/procedures`")]


def answer_errors(app: FastAPI) -> None:
    """Answer errors of `app` by a `Refusal`: input 422, device 409, journal 409, the rest by its status."""

    @app.exception_handler(Refused)
    async def _(request: Request, error: Refused) -> JSONResponse:
        headers = {"www-authenticate": "Bearer"} if error.status == 401 else None
        return _failure(error.status, error.what, error.cure, headers)

    @app.exception_handler(NotAllowed)
    async def _(request: Request, error: NotAllowed) -> JSONResponse:
        return _failure(403, error.problems[0].what, error.problems[0].cure)

    @app.exception_handler(InputError)
    @app.exception_handler(DeviceError)
    @app.exception_handler(JournalError)
    async def _(request: Request, error: Exception) -> JSONResponse:
        problems = Failure.of(error).problems or (Problem("", 0, 0, "the input is wrong"),)
        status = 422 if isinstance(error, InputError) else 409
        return _failure(status, problems[0].what, problems[0].cure, problems=[ProblemOut.of(each) for each in problems])

    @app.exception_handler(RequestValidationError)
    async def _(request: Request, error: RequestValidationError) -> JSONResponse:
        found = [
            ProblemOut(file=".".join(str(part) for part in one["loc"]), what=str(one["msg"])) for one in error.errors()
        ]
        what, cure = "the request is not as the API describes it", "compare it with /api/openapi.json"
        return _failure(422, what, cure, problems=found)

    @app.exception_handler(HTTPException)
    async def _(request: Request, error: HTTPException) -> JSONResponse:
        if error.status_code == 400:
            return _failure(422, f"the content cannot be read: {error.detail}", "send JSON in UTF-8, or a form")
        return _failure(error.status_code, str(error.detail), "see /api")


def answer_unknown(app: FastAPI) -> None:
    """Answer what is no route of the API: 404, or 405 for another method. Call it after the routes were added."""

    @app.api_route("/api/{rest:path}", methods=[*_METHODS], include_in_schema=False, operation_id="unknown")
    async def unknown(request: Request) -> JSONResponse:
        """No route of the API."""
        path = request.scope["path"]
        known = {method for method, form in operations(app.openapi()) if compile_path(form)[0].match(path)}
        if not known:
            return _failure(404, f"there is no {path[:200]}", "see /api")
        allowed = ", ".join(sorted(known))
        return _failure(405, f"{path[:200]} does not take {request.method}", f"send {allowed}", {"allow": allowed})


def _failure(
    status: int, what: str, cure: str, headers: dict[str, str] | None = None, problems: Sequence[ProblemOut] = ()
) -> JSONResponse:
    content = Refusal(what=what, cure=cure, problems=list(problems))
    return JSONResponse(content.model_dump(), status, headers)
