"""Error messages for values in our own words, without the validating library's terms."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import ValidationError

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


def read_json(path: Path, what: str, cure: str) -> Any:
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


def content_problems(error: ValidationError, path: Path, what: str, cure: str) -> list[Problem]:
    """The first errors in the content of a file that is to be a `what`, and how many more there are."""
    places = {".".join(map(str, detail["loc"])): plain_words(detail) for detail in error.errors(include_url=False)}
    words = [f"is no {what}: {at or 'content'}: {why}" for at, why in places.items()]
    more = [f"and {len(words) - _MOST} more errors like these"] if len(words) > _MOST else []
    return [Problem(str(path), 0, 0, each, cure) for each in [*words[:_MOST], *more]]
