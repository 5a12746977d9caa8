"""Content of YAML and JSON files as typed models: every error at once, each with its place, in our own words."""

from __future__ import annotations

import difflib
import json
import pathlib
from collections.abc import Mapping
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from cellctl.files._strict_yaml import Document, Path
from cellctl.files.kinds import kind_of_content, read_bytes, refuse_other_kind
from cellctl.files.problems import InputError, Problem

_MOST = 5
_WORDS = {
    "int": "has to be a whole number",
    "float": "has to be a number",
    "string": "has to be text",
    "bool": "has to be true or false",
    "list": "has to be a list",
    "tuple": "has to be a list",
    "dict": "has to be a mapping",
    "model": "has to be a mapping",
    "dataclass": "has to be a mapping",
}
"""By the first word of pydantic's type of error."""
_EXACT = {
    "finite_number": "has to be a finite number",
    "literal_error": "has to be {expected}",
    "enum": "has to be {expected}",
    "greater_than": "has to be above {gt:g}",
    "greater_than_equal": "has to be at least {ge:g}",
    "less_than": "has to be below {lt:g}",
    "less_than_equal": "has to be at most {le:g}",
    "too_short": "needs {min_length} items or more",
    "too_long": "takes {max_length} items at most",
    "string_too_short": "needs {min_length} letters or more",
    "string_too_long": "takes {max_length} letters at most",
    "string_pattern_mismatch": "is not written as it has to be",
    "union_tag_invalid": "'{tag}' is not known, only {expected_tags}",
    "union_tag_not_found": "has to say its {discriminator}",
    "missing": "is missing",
    "extra_forbidden": "is not known here",
    "value_error": "{error}",
}


def plain_words(detail: Mapping[str, Any]) -> str:
    """The message for one detail of a pydantic.ValidationError: `has to be at least 10`, `is missing`."""
    kind = str(detail["type"])
    words = _EXACT.get(kind) or _WORDS.get(kind.partition("_")[0], "is not what belongs here")
    return words.format(**detail.get("ctx", {}))


def read_json(path: pathlib.Path, what: str, cure: str) -> Any:
    """The content of a JSON file that is to be a `what` (`model file`).

    Raises InputError with `cure` if it cannot be read or is not JSON.
    """
    try:
        content = json.loads(read_bytes(path, what))
        refuse_other_kind(path, what, kind_of_content(content))
        return content
    except json.JSONDecodeError as error:
        why = f"it is no JSON from line {error.lineno}, column {error.colno} on"
    except UnicodeDecodeError:
        why = "it is not UTF-8 text"
    except (ValueError, RecursionError):
        why = "it is no JSON that can be read"
    refuse_other_kind(path, what)
    raise InputError(Problem(str(path), 0, 0, f"is no {what}: {why}", cure))


def content_problems(error: ValidationError, path: pathlib.Path, what: str, cure: str) -> list[Problem]:
    """The first errors in the content of a file that is to be a `what`, and how many more there are."""
    places = {".".join(map(str, detail["loc"])): plain_words(detail) for detail in error.errors(include_url=False)}
    words = [f"is no {what}: {at or 'content'}: {why}" for at, why in places.items()]
    more = [f"and {len(words) - _MOST} more errors like these"] if len(words) > _MOST else []
    return [Problem(str(path), 0, 0, each, cure) for each in [*words[:_MOST], *more]]


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
