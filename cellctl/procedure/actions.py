"""The actions of a procedure file: steps, loops, `if` and `confirm`, read with all their errors."""

from __future__ import annotations

import math
from typing import Any

from cellctl.files import Path
from cellctl.procedure.expressions import EXPRESSION_RULE, Expression
from cellctl.procedure.fields import Fields, Findings
from cellctl.procedure.model import Action, Confirm, If, Loop, OnResume, Retry, Step
from cellctl.procedure.references import Reference

_STEP = ("id", "do", "with", "timeout", "retry", "on_resume")
_LOOP = ("id", "title", "for_each", "as", "steps")
_IF = ("id", "if", "then", "else")
_CONFIRM = ("id", "confirm", "timeout", "on_resume")


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
