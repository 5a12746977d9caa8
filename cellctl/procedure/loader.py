"""Reads a procedure file into its model. Errors do not stop the reading; `Procedure.problems` lists all."""

from __future__ import annotations

import pathlib
from dataclasses import replace
from typing import Any

from cellctl.files import Document, Path, load_yaml
from cellctl.files.kinds import PROCEDURE
from cellctl.procedure.actions import read_actions, read_cleanup
from cellctl.procedure.fields import NAME_RULE, Fields, Findings, is_name
from cellctl.procedure.model import Interlock, OnBreak, Parameter, ParameterType, Procedure, Resume
from cellctl.procedure.parameters import as_typed, misfit

_PROCEDURE = ("procedure", "title", "cell", "parameters", "interlocks", "steps", "cleanup")
_PARAMETER = ("type", "default", "min", "max", "choices", "unit", "help")
_INTERLOCK = ("id", "device", "condition", "on_break", "resume")


def load_procedure(path: pathlib.Path) -> Procedure:
    """Read a procedure file. Raises InputError only if it is not readable YAML, or another file; see
    `Procedure.problems`.
    """
    return read_procedure(load_yaml(path, PROCEDURE))


def read_procedure(document: Document) -> Procedure:
    """The procedure in `document`; the path of its cell is relative to the document's folder."""
    findings = Findings(document)
    fields = Fields(findings, document.data, (), _PROCEDURE, "a procedure")
    cell = fields.text("cell")
    procedure = Procedure(
        document,
        name=fields.name("procedure"),
        title=fields.text("title"),
        cell=pathlib.Path(document.file).parent / cell if cell else None,
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
