"""Validates a YAML document as a typed model: every error at once, each with its place."""

from __future__ import annotations

import difflib
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from cellctl.files._strict_yaml import Document, Path
from cellctl.files.plain_words import plain_words
from cellctl.files.problems import InputError, Problem

Model = TypeVar("Model", bound=BaseModel)

_LONGEST = 80
"""Letters of a wrong value that a message shows."""


def validated(document: Document, model: type[Model], at: Path = ()) -> Model:
    """The part of `document` at `at` as `model`. Raises InputError with all errors, placed in the file."""
    value = _part(document, at)
    try:
        return model.model_validate(value)
    except ValidationError as error:
        raise InputError(problems_of(error, document, at, model)) from error


def _part(document: Document, at: Path) -> Any:
    value = document.data
    for depth, key in enumerate(at):
        try:
            value = value[key]
        except (KeyError, IndexError, TypeError) as error:
            raise InputError(document.problem(at[:depth], f"'{key}' is missing", f"add '{key}:'")) from error
    if value is None:
        name = f"'{at[-1]}'" if at else "the file"
        raise InputError(document.problem(at, f"{name} is empty", "the manual shows what belongs here"))
    return value


def problems_of(
    error: ValidationError, document: Document, at: Path = (), model: type[BaseModel] | None = None
) -> list[Problem]:
    """The errors in a pydantic error as problems placed in `document`, whose part at `at` was validated."""
    found: dict[tuple[Path, str], Problem] = {}
    for detail in error.errors(include_url=False):
        path = _known_part(document, (*at, *detail["loc"]), named=detail["type"] in ("missing", "extra_forbidden"))
        unknown = detail["type"] == "extra_forbidden"
        what, cure = _words(detail, path, model)
        found[(path, what)] = document.problem(path, what, cure, key=unknown)
    return list(found.values())


def _known_part(document: Document, path: tuple[Any, ...], *, named: bool) -> Path:
    """`path` without pydantic's internal parts (names of union members and validators).

    For a missing or unknown name, the last part is that name.
    """
    known: Path = ()
    for index, part in enumerate(path):
        if (*known, part) in document.marks or (named and index == len(path) - 1):
            known = (*known, part)
    return known


def _words(detail: Any, path: Path, model: type[BaseModel] | None) -> tuple[str, str]:
    name = ".".join(str(part) for part in path) or "the file"
    match detail["type"]:
        case "extra_forbidden":
            near = difflib.get_close_matches(str(path[-1]), sorted(_field_names(model)), n=1)
            return f"'{path[-1]}' is not known here", f"did you mean '{near[0]}'?" if near else "remove it"
        case "missing":
            return f"'{path[-1]}' is missing", f"add '{path[-1]}:'"
        case "value_error":
            return f"{name}: {detail['ctx']['error']}", ""
        case _:
            given = detail["input"]
            text = repr(given) if len(repr(given)) <= _LONGEST else f"{repr(given)[:_LONGEST]}…"
            shown = f" (here: {text})" if not isinstance(given, dict | list) else ""
            return f"{name}: {plain_words(detail)}{shown}", ""


def _field_names(model: type[BaseModel] | None) -> set[str]:
    if model is None:
        return set()
    schema = model.model_json_schema()
    parts = [schema, *schema.get("$defs", {}).values()]
    return {name for part in parts for name in part.get("properties", {})}
