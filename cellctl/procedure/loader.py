"""Reads a procedure file and its parameters' settings. Errors do not stop it; `Procedure.problems` lists all."""

from __future__ import annotations

import math
import pathlib
import re
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from cellctl.files import Document, InputError, Path, Problem, load_yaml
from cellctl.files.kinds import PROCEDURE
from cellctl.installed import cell_file
from cellctl.procedure.fields import NAME_RULE, Fields, Findings, did_you_mean, is_name, is_number
from cellctl.procedure.model import (
    Action,
    Confirm,
    If,
    Interlock,
    Loop,
    OnBreak,
    OnResume,
    Parameter,
    ParameterType,
    Procedure,
    Resume,
    Retry,
    Step,
)
from cellctl.procedure.references import EXPRESSION_RULE, Expression, Reference

_INTEGER = re.compile(r"[-+]?[0-9]{1,18}")
_CALLED = {
    ParameterType.INTEGER: "a whole number",
    ParameterType.NUMBER: "a number",
    ParameterType.TEXT: "text",
    ParameterType.FLAG: "true or false",
}

_STEP = ("id", "do", "with", "timeout", "retry", "on_resume")
_LOOP = ("id", "title", "for_each", "as", "steps")
_IF = ("id", "if", "then", "else")
_CONFIRM = ("id", "confirm", "timeout", "on_resume")

_PROCEDURE = ("procedure", "title", "cell", "parameters", "interlocks", "steps", "cleanup")
_PARAMETER = ("type", "default", "min", "max", "choices", "unit", "help")
_INTERLOCK = ("id", "device", "condition", "on_break", "resume")


def load_procedure(path: pathlib.Path) -> Procedure:
    """Read a procedure file. Raises InputError only if it is not readable YAML, or another file; see
    `Procedure.problems`.
    """
    return read_procedure(load_yaml(path, PROCEDURE))


def read_procedure(document: Document) -> Procedure:
    """The procedure in `document`; its cell is a path from the document's folder, or a shipped name."""
    findings = Findings(document)
    fields = Fields(findings, document.data, (), _PROCEDURE, "a procedure")
    cell = fields.text("cell")
    procedure = Procedure(
        document,
        name=fields.name("procedure"),
        title=fields.text("title"),
        cell=cell_file(cell, pathlib.Path(document.file).parent) if cell else None,
        parameters=_parameters(findings, fields),
        steps=read_actions(findings, fields.raw("steps", needed=True), ("steps",)) if "steps" in fields else (),
        cleanup=read_cleanup(findings, fields),
        interlocks=_interlocks(findings, fields),
    )
    if "steps" not in fields:
        findings.report((), "the procedure has no steps", "add 'steps:' with at least one step")
    return replace(procedure, problems=tuple(findings.problems))


def _parameters(findings: Findings, fields: Fields) -> dict[str, Parameter]:
    value = fields.raw("parameters")
    if "parameters" in fields and not isinstance(value, dict):
        fields.report("parameters", "parameters have to be a mapping", "write 'name: {type: …, default: …}' each")
    if not isinstance(value, dict):
        return {}
    return {name: _parameter(findings, name, each, ("parameters", name)) for name, each in value.items()}


def _parameter(findings: Findings, name: str, value: Any, at: Path) -> Parameter:
    if not is_name(name):
        findings.report(at, f"'{name}' is no name for a parameter", NAME_RULE, key=True)
    fields = Fields(findings, value, at, _PARAMETER, f"parameter '{name}'")
    before = len(findings.problems)
    kind = ParameterType(fields.one_of("type", tuple(ParameterType), ParameterType.TEXT, needed=True))
    parameter = Parameter(
        name,
        kind,
        min=fields.number("min"),
        max=fields.number("max"),
        choices=fields.words("choices"),
        unit=fields.text("unit"),
        help=fields.text("help"),
        at=at,
    )
    if len(findings.problems) > before:  # do not report consequences of an error
        return parameter
    _bounds_make_sense(fields, parameter)
    if "default" not in fields or len(findings.problems) > before:
        return parameter
    default = fields.raw("default")
    if fault := misfit(parameter, default):
        fields.report("default", f"the default of {fault[0]}", fault[1])
        return parameter
    return replace(parameter, default=as_typed(parameter, default))


def _bounds_make_sense(fields: Fields, parameter: Parameter) -> None:
    numeric = parameter.type in (ParameterType.INTEGER, ParameterType.NUMBER)
    for key in ("min", "max"):
        if key in fields and not numeric:
            fields.report(key, f"'{key}' has no meaning for a parameter of type {parameter.type}", "remove it")
    if parameter.choices and parameter.type is not ParameterType.TEXT:
        fields.report("choices", "choices are for parameters of type text", "remove them, or use min and max")
    if parameter.min is not None and parameter.max is not None and parameter.min > parameter.max:
        fields.report("min", f"min is above max in parameter '{parameter.name}'", "swap them")


def _interlocks(findings: Findings, fields: Fields) -> tuple[Interlock, ...]:
    value = fields.raw("interlocks")
    if "interlocks" in fields and not isinstance(value, list):
        fields.report("interlocks", "interlocks have to be a list", "write '- {id: …, device: …, condition: …}' each")
    entries = value if isinstance(value, list) else []
    return tuple(_interlock(findings, each, ("interlocks", index)) for index, each in enumerate(entries))


def _interlock(findings: Findings, value: Any, at: Path) -> Interlock:
    fields = Fields(findings, value, at, _INTERLOCK, "an interlock")
    on_break = OnBreak(fields.one_of("on_break", tuple(OnBreak), OnBreak.STOP))
    resume = Resume(fields.one_of("resume", tuple(Resume), Resume.OPERATOR))
    if on_break is OnBreak.ABORT and "resume" in fields:
        fields.report("resume", "an interlock that aborts the run has nothing to resume", "remove it")
    condition = fields.text("condition", needed=True)
    return Interlock(fields.name("id"), fields.text("device", needed=True), condition, on_break, resume, at)


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


def read_actions(findings: Findings, value: Any, at: Path) -> tuple[Action, ...]:
    """The list of actions `value`, found at `at`; if it is not a list, reports that and returns an empty one."""
    if not isinstance(value, list) or not value:
        what = "there is no step here" if value is None or value == [] else "steps have to be a list"
        findings.report(at, what, "write at least one '- {id: …, do: …}'")
        return ()
    return tuple(_action(findings, each, (*at, index)) for index, each in enumerate(value))


def read_cleanup(findings: Findings, fields: Fields) -> tuple[Step, ...]:
    """Steps only: each has a time limit and runs even if others failed, so none may depend on a list."""
    actions = read_actions(findings, fields.raw("cleanup"), ("cleanup",)) if "cleanup" in fields else ()
    for action in actions:
        if not isinstance(action, Step):
            what = "clean-up has no loops, no 'if' and no 'confirm'"
            findings.report(action.at, what, "write its steps one after the other")
    return tuple(action for action in actions if isinstance(action, Step))


def _action(findings: Findings, value: Any, at: Path) -> Action:
    keys = value if isinstance(value, dict) and "do" not in value else ()
    if "for_each" in keys or "steps" in keys:
        return _loop(findings, value, at)
    if "if" in keys:
        return _if(findings, value, at)
    if "confirm" in keys:
        return _confirm(findings, value, at)
    return _step(findings, value, at)


def _if(findings: Findings, value: Any, at: Path) -> If:
    fields = Fields(findings, value, at, _IF, "an 'if'")
    line, column = findings.document.place(at)
    then = read_actions(findings, fields.raw("then"), (*at, "then"))
    otherwise = read_actions(findings, fields.raw("else"), (*at, "else")) if "else" in fields else ()
    return If(fields.name("id"), _expression(fields), then, otherwise, at, line, column)


def _expression(fields: Fields) -> Expression | None:
    text = fields.text("if")
    try:
        return Expression.parse(text) if text else None
    except ValueError as error:
        fields.report("if", str(error), EXPRESSION_RULE)
        return None


def _confirm(findings: Findings, value: Any, at: Path) -> Confirm:
    fields = Fields(findings, value, at, _CONFIRM, "a 'confirm'")
    line, column = findings.document.place(at)
    text = fields.text("confirm")
    if not text.strip() and isinstance(fields.raw("confirm"), str):
        fields.report("confirm", "the text of a 'confirm' is empty", "write what the operator has to look at, or do")
    if "${" in text:
        fields.report("confirm", "the text of a 'confirm' has no references", "write the text itself")
    on_resume = OnResume(fields.one_of("on_resume", tuple(OnResume), OnResume.SKIP))
    return Confirm(fields.name("id"), text, fields.number("timeout", above=0), on_resume, at, line, column)


def _loop(findings: Findings, value: Any, at: Path) -> Loop:
    fields = Fields(findings, value, at, _LOOP, "a loop")
    line, column = findings.document.place(at)
    return Loop(
        id=fields.name("id"),
        for_each=_for_each(findings, fields),
        variable=fields.name("as"),
        steps=read_actions(findings, fields.raw("steps"), (*at, "steps")),
        at=at,
        line=line,
        column=column,
        title=fields.text("title"),
    )


def _for_each(findings: Findings, fields: Fields) -> Reference | list[Any]:
    value = _with_references(findings, fields.raw("for_each", needed=True), (*fields.at, "for_each"))
    if isinstance(value, Reference | list):
        return value
    if value is not None:
        fields.report("for_each", "'for_each' takes a list", "name one: ${step.field}, or write it: [1, 2, 3]")
    return []


def _step(findings: Findings, value: Any, at: Path) -> Step:
    fields = Fields(findings, value, at, _STEP, "a step")
    line, column = findings.document.place(at)
    return Step(
        id=fields.name("id"),
        do=fields.text("do", needed=True),
        inputs=_inputs(findings, fields),
        timeout_s=fields.number("timeout", above=0),
        retry=_retry(findings, fields),
        on_resume=OnResume(fields.one_of("on_resume", tuple(OnResume), OnResume.SKIP)),
        at=at,
        line=line,
        column=column,
    )


def _inputs(findings: Findings, fields: Fields) -> dict[str, Any]:
    value = fields.raw("with")
    if isinstance(value, dict):
        return {key: _with_references(findings, each, (*fields.at, "with", key)) for key, each in value.items()}
    if value is not None:
        fields.report("with", "'with' has to be a mapping", "write 'with: {input: value}'")
    return {}


def _retry(findings: Findings, fields: Fields) -> Retry:
    if "retry" not in fields:
        return Retry()
    inner = Fields(findings, fields.raw("retry"), (*fields.at, "retry"), ("attempts", "on"), "retry")
    return Retry(inner.integer("attempts", 1, least=1), inner.words("on"))


def _with_references(findings: Findings, value: Any, at: Path) -> Any:
    match value:
        case dict():
            return {key: _with_references(findings, each, (*at, key)) for key, each in value.items()}
        case list():
            return [_with_references(findings, each, (*at, index)) for index, each in enumerate(value)]
        case str() if "${" in value:
            return _reference(findings, value, at)
        case float() if not math.isfinite(value):
            findings.report(at, "this is no finite number", "write a number, or leave the input out")
            return Reference("")
        case _:
            return value


def _reference(findings: Findings, text: str, at: Path) -> Any:
    try:
        return Reference.parse(text)
    except ValueError:
        cure = "a reference is a whole value: ${name}, ${name.field} or ${name[3].x}; there are no expressions"
        findings.report(at, f"'{text}' is no reference", cure)
        return Reference("")
