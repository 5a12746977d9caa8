"""Parameters that the operator may set, from the file and from `--set name=value`."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

from cellctl.files import InputError, Problem
from cellctl.procedure.fields import is_number
from cellctl.procedure.model import Parameter, ParameterType, Procedure
from cellctl.procedure.suggest import did_you_mean

_INTEGER = re.compile(r"[-+]?[0-9]{1,18}")
_CALLED = {
    ParameterType.INTEGER: "a whole number",
    ParameterType.NUMBER: "a number",
    ParameterType.TEXT: "text",
    ParameterType.FLAG: "true or false",
}


def resolve_parameters(procedure: Procedure, settings: Sequence[str] = ()) -> dict[str, Any]:
    """Every parameter's value: from `settings` (`name=value` each), else its default.

    Raises InputError with all errors in the settings.
    """
    values, problems = read_settings(procedure, settings)
    if problems:
        raise InputError(problems)
    return values


def read_settings(procedure: Procedure, settings: Sequence[str]) -> tuple[dict[str, Any], list[Problem]]:
    """The valid values, and the errors; only parameters with a valid value are included."""
    given: dict[str, str] = {}
    problems: list[Problem] = []
    for setting in settings:
        name, equals, text = setting.partition("=")
        if fault := _misuse(procedure, name.strip(), equals, given):
            problems.append(Problem(f"--set {setting}", 0, 0, *fault))
        else:
            given[name.strip()] = text.strip()
    values: dict[str, Any] = {}
    for parameter in procedure.parameters.values():
        value, problem = _value_of(procedure, parameter, given.get(parameter.name))
        if problem:
            problems.append(problem)
        elif value is not None:
            values[parameter.name] = value
    return values, problems


def misfit(parameter: Parameter, value: Any) -> tuple[str, str] | None:
    """The error of `value` for `parameter`, and the cure; None if it is valid."""
    if not _of_type(parameter.type, value):
        return f"'{parameter.name}' takes {_CALLED[parameter.type]} (here: {value!r})", _allowed(parameter)
    if parameter.choices and value not in parameter.choices:
        return f"'{parameter.name}' has no choice {value!r}", did_you_mean(value, parameter.choices)
    low, high = parameter.min, parameter.max
    if (low is not None and value < low) or (high is not None and value > high):
        return f"'{parameter.name}' is out of its range (here: {value:g})", _allowed(parameter)
    return None


def as_typed(parameter: Parameter, value: Any) -> Any:
    """`value`, a number as a float, so that 5 and 5.0 are equal."""
    return float(value) if parameter.type is ParameterType.NUMBER else value


def _value_of(procedure: Procedure, parameter: Parameter, text: str | None) -> tuple[Any, Problem | None]:
    if text is None:
        if parameter.default is None and not procedure.problems:
            what = f"'{parameter.name}' has no default and was not given"
            return None, procedure.document.problem(
                parameter.at, what, f"add --set {parameter.name}=…  ({_allowed(parameter)})"
            )
        return parameter.default, None
    value = _from_text(parameter.type, text)
    if fault := misfit(parameter, value):
        return None, Problem(f"--set {parameter.name}={text}", 0, 0, *fault)
    return as_typed(parameter, value), None


def _misuse(procedure: Procedure, name: str, equals: str, given: dict[str, str]) -> tuple[str, str] | None:
    if not equals:
        return "is no setting", "write --set name=value"
    if name not in procedure.parameters:
        return f"procedure '{procedure.name}' has no parameter '{name}'", did_you_mean(name, procedure.parameters)
    if name in given:
        return f"'{name}' is given twice", f"keep one of them (the other says {given[name]!r})"
    return None


def _from_text(kind: ParameterType, text: str) -> Any:
    """The value that `text` represents; the text itself if it is not of this kind."""
    if kind is ParameterType.INTEGER and _INTEGER.fullmatch(text):
        return int(text)
    if kind is ParameterType.NUMBER:
        try:
            return float(text)
        except ValueError:
            return text
    if kind is ParameterType.FLAG and text in ("true", "false"):
        return text == "true"
    return text


def _of_type(kind: ParameterType, value: Any) -> bool:
    match kind:
        case ParameterType.INTEGER:
            return is_number(value) and isinstance(value, int)
        case ParameterType.NUMBER:
            return is_number(value)
        case ParameterType.TEXT:
            return isinstance(value, str)
        case ParameterType.FLAG:
            return isinstance(value, bool)


def _allowed(parameter: Parameter) -> str:
    if parameter.choices:
        return f"one of: {', '.join(parameter.choices)}"
    unit = f" {parameter.unit}" if parameter.unit else ""
    low = "" if parameter.min is None else f", {parameter.min:g}{unit} or more"
    high = "" if parameter.max is None else f", {parameter.max:g}{unit} at most"
    return f"give {_CALLED[parameter.type]}{low}{high}"
