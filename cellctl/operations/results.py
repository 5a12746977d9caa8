"""JSON of a service's result, and the result of its JSON: the fields of the dataclass are the keys, in their order."""

from __future__ import annotations

from typing import Any, TypeVar

from pydantic import TypeAdapter

Result = TypeVar("Result")


def as_json(result: object) -> dict[str, Any]:
    """A dataclass as JSON has it."""
    content: dict[str, Any] = TypeAdapter(type(result)).dump_python(result, mode="json")
    return content


def from_json(kind: type[Result], content: object) -> Result:
    """The inverse of `as_json`. Raises ValidationError."""
    return TypeAdapter(kind).validate_python(content)
