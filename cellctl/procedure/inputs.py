"""Checks a step's inputs against its model: missing, unknown, wrong type or out of range, each with its cure."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from pydantic import ValidationError

from cellctl.files import Document, InputError, Path, Problem
from cellctl.files.plain_words import plain_words
from cellctl.procedure.fields import is_number
from cellctl.procedure.model import Procedure, Step
from cellctl.procedure.references import UnresolvedReference, resolve
from cellctl.procedure.steps import AnyStepKind
from cellctl.procedure.suggest import did_you_mean

_WRITE = {
    "int_type": "write a whole number",
    "int_from_float": "write a whole number",
    "float_type": "write a number",
    "string_type": "write text, in quotes if need be",
    "bool_type": "write true or false",
    "list_type": "write a list: [ … ]",
    "tuple_type": "write a list: [ … ]",
    "dict_type": "write a mapping: {name: value}",
    "model_type": "write a mapping: {name: value}",
    "finite_number": "write a finite number",
}
_BOUNDS = {"ge": "at least", "gt": "above", "le": "at most", "lt": "below"}


def inputs_of(procedure: Procedure, step: Step, kind: AnyStepKind, scope: Mapping[str, Any]) -> Any:
    """The step's inputs, its references resolved in `scope` (name → JSON), as the model that the step takes.

    Raises InputError, placed in the procedure file.
    """
    at = (*step.at, "with")
    try:
        return kind.read_inputs(resolve(step.inputs, scope))
    except UnresolvedReference as error:
        raise InputError(procedure.document.problem(at, str(error))) from error
    except ValidationError as error:
        raise InputError(input_problems(error, procedure.document, at, kind)) from error


def input_problems(
    error: ValidationError, document: Document, at: Path, kind: AnyStepKind, unknown: Iterable[Path] = ()
) -> list[Problem]:
    """The errors in `error`, each placed under `at`; values that depend on `unknown` inputs are not checked."""
    skipped = tuple(unknown)
    found: dict[tuple[Path, str], Problem] = {}
    for detail in error.errors(include_url=False):
        location = detail["loc"]
        if any(_overlap(location, path) for path in skipped):
            continue
        what, cure = _words(detail, kind)
        place = _placed(document, at, location)
        found[(place, what)] = document.problem(place, what, cure, key=detail["type"] == "extra_forbidden")
    return list(found.values())


def _overlap(one: tuple[Any, ...], other: tuple[Any, ...]) -> bool:
    shorter = min(len(one), len(other))
    return one[:shorter] == other[:shorter]


def _placed(document: Document, at: Path, location: tuple[Any, ...]) -> Path:
    place = at
    for part in location:
        if (*place, part) not in document.marks:
            break
        place = (*place, part)
    return place


def _words(detail: Any, kind: AnyStepKind) -> tuple[str, str]:
    name = ".".join(str(part) for part in detail["loc"])
    last = str(detail["loc"][-1]) if detail["loc"] else ""
    match detail["type"]:
        case "extra_forbidden":
            near = did_you_mean(last, kind.input_names(), "remove it")
            return f"step {kind.name} has no input '{name}'", near
        case "missing":
            return f"step {kind.name} needs the input '{name}'", f"add '{last}:' under 'with:'{_help(kind, last)}"
        case "value_error":
            return f"inputs of {kind.name}: {name + ': ' if name else ''}{detail['ctx']['error']}", ""
        case _:
            given = detail["input"]
            shown = f" (here: {given!r})" if not isinstance(given, dict | list) else ""
            return f"input '{name}' of {kind.name}: {plain_words(detail)}{shown}", _cure(detail, kind)


def _cure(detail: Any, kind: AnyStepKind) -> str:
    context = detail.get("ctx", {})
    for bound, words in _BOUNDS.items():
        if is_number(context.get(bound)):
            return f"give {words} {context[bound]:g}{_help(kind, str(detail['loc'][0]))}"
    if "expected" in context:
        return f"write {context['expected']}"
    return _WRITE.get(detail["type"], "") + _help(kind, str(detail["loc"][0]) if detail["loc"] else "")


def _help(kind: AnyStepKind, name: str) -> str:
    field = kind.inputs.model_fields.get(name)
    return f" ({field.description})" if field and field.description else ""
