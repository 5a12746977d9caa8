"""JSON of a service's result, and the result of its JSON: the fields of the dataclass are the keys, in their order."""

from __future__ import annotations

from functools import cache
from typing import Any, TypeVar

from pydantic import TypeAdapter

Result = TypeVar("Result")


def as_json(result: object) -> dict[str, Any]:
    """A dataclass as JSON has it."""
    kind: Any = type(result)
    content: dict[str, Any] = _adapter(kind).dump_python(result, mode="json")
    return content


def from_json(kind: type[Result], content: object) -> Result:
    """The inverse of `as_json`. Raises ValidationError."""
    wanted: Any = kind
    found: Result = _adapter(wanted).validate_python(content)
    return found


@cache
def _adapter(kind: Any) -> TypeAdapter[Any]:
    """Kept: to make one takes some milliseconds, and a list of results needs it for each."""
    return TypeAdapter(kind)
