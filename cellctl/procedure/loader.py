"""From a procedure file to the model of it. Mistakes do not end the reading; they are all in `Procedure.problems`."""

from __future__ import annotations

import math
import pathlib
from dataclasses import replace
from typing import Any

from cellctl.files import Document, Path, load_yaml
from cellctl.procedure.fields import NAME_RULE, Fields, Findings, is_name
from cellctl.procedure.model import Action, Loop, OnResume, Parameter, ParameterType, Procedure, Retry, Step
from cellctl.procedure.parameters import as_typed, misfit
from cellctl.procedure.references import Reference

_PROCEDURE = ("procedure", "title", "cell", "parameters", "steps", "cleanup")
_PARAMETER = ("type", "default", "min", "max", "choices", "unit", "help")
_STEP = ("id", "do", "with", "timeout", "retry", "on_resume")
_LOOP = ("id", "for_each", "as", "steps")


def load_procedure(path: pathlib.Path) -> Procedure:
    """Read a procedure file. Raises InputError only where it is no readable YAML; see `Procedure.problems`."""
    return read_procedure(load_yaml(path))


def read_procedure(document: Document) -> Procedure:
    """The procedure in `document`, whose file names the folder against which its cell is read."""
    findings = Findings(document)
    fields = Fields(findings, document.data, (), _PROCEDURE, "a procedure")
    cell = fields.text("cell")
    procedure = Procedure(
        document,
        name=fields.name("procedure"),
        title=fields.text("title"),
        cell=pathlib.Path(document.file).parent / cell if cell else None,
        parameters=_parameters(findings, fields),
        steps=_actions(findings, fields.raw("steps", needed=True), ("steps",)) if "steps" in fields else (),
        cleanup=_cleanup(findings, fields),
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
    if len(findings.problems) > before:  # what follows from a mistake is not another one
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


def _actions(findings: Findings, value: Any, at: Path) -> tuple[Action, ...]:
    if not isinstance(value, list) or not value:
        what = "there is no step here" if value is None or value == [] else "steps have to be a list"
        findings.report(at, what, "write at least one '- {id: …, do: …}'")
        return ()
    return tuple(_action(findings, each, (*at, index)) for index, each in enumerate(value))


def _cleanup(findings: Findings, fields: Fields) -> tuple[Step, ...]:
    """Steps only: each is bounded and tried, whatever the others did, so that no list has to be there."""
    actions = _actions(findings, fields.raw("cleanup"), ("cleanup",)) if "cleanup" in fields else ()
    for action in actions:
        if isinstance(action, Loop):
            findings.report(action.at, "clean-up has no loops", "write its steps one after the other")
    return tuple(action for action in actions if isinstance(action, Step))


def _action(findings: Findings, value: Any, at: Path) -> Action:
    if isinstance(value, dict) and "do" not in value and ("for_each" in value or "steps" in value):
        return _loop(findings, value, at)
    return _step(findings, value, at)


def _loop(findings: Findings, value: Any, at: Path) -> Loop:
    fields = Fields(findings, value, at, _LOOP, "a loop")
    line, column = findings.document.place(at)
    return Loop(
        id=fields.name("id"),
        for_each=_for_each(findings, fields),
        variable=fields.name("as"),
        steps=_actions(findings, fields.raw("steps"), (*at, "steps")),
        at=at,
        line=line,
        column=column,
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
