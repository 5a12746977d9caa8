"""All errors of a procedure, before any motion: structure, names, references, steps, inputs, devices, settings."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, final

from pydantic import ValidationError

from cellctl.files import Document, InputError, Path, Problem
from cellctl.files.validated import plain_words
from cellctl.procedure._scope import NoSuchPart, Scope, Shape, Unreachable, element_of, kind_of_shape
from cellctl.procedure._steps import AnyStepKind
from cellctl.procedure.fields import Findings, did_you_mean, is_number
from cellctl.procedure.loader import read_settings
from cellctl.procedure.model import Action, If, Interlock, Loop, Procedure, Step
from cellctl.procedure.references import (
    EXPRESSION_RULE,
    Reference,
    UnresolvedReference,
    known_part,
    references_in,
    resolve,
)
from cellctl.procedure.registry import BrokenSteps, StepRegistry, UnknownStep

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

Devices = Mapping[str, type | None]
"""The cell's devices: name → the driver's class, or None if unknown before opening."""

DeviceConditions = Mapping[str, Mapping[str, str]]
"""Device → the names of its conditions, each with its text; only devices that have conditions."""


def check(
    procedure: Procedure,
    parameters: Mapping[str, Any],
    registry: StepRegistry,
    devices: Devices | None,
    conditions: DeviceConditions | None = None,
) -> list[Problem]:
    """Every error in `procedure`, reading errors included, sorted by place; empty if it can be run.

    `parameters`: name → value; a missing one counts as not known yet. `devices` None: the cell is not known
    (its file has errors itself), and devices are not checked. `conditions` None: those of the devices are
    not known. Opens nothing.
    """
    checker = _Checker(procedure, registry, devices)
    checker.actions(procedure.steps, Scope.of_parameters(procedure, parameters))
    checker.actions(procedure.cleanup, Scope.of_parameters(procedure, parameters))
    checker.names()
    checker.interlocks(conditions)
    found = {*procedure.problems, *checker.findings.problems}
    return sorted(found, key=lambda problem: (problem.line, problem.column, problem.what))


def checked_parameters(
    procedure: Procedure,
    settings: Sequence[str],
    registry: StepRegistry,
    devices: Devices | None,
    conditions: DeviceConditions | None = None,
) -> dict[str, Any]:
    """The parameters of a procedure without errors, `settings` (`name=value`) included.

    Raises InputError with every error in settings and procedure at once.
    """
    values, problems = read_settings(procedure, settings)
    problems += check(procedure, values, registry, devices, conditions)
    if problems:
        raise InputError(problems)
    return values


@final
class _Checker:
    def __init__(self, procedure: Procedure, registry: StepRegistry, devices: Devices | None) -> None:
        self.findings = Findings(procedure.document)
        self._procedure = procedure
        self._registry = registry
        self._devices = devices
        self._devices_named: set[str] = set()

    def names(self) -> None:
        first: dict[str, Action] = {}
        for action in self._procedure.actions():
            at = (*action.at, "id")
            if action.id in self._procedure.parameters:
                self.findings.report(at, f"'{action.id}' is also a parameter", "give the step another name")
            elif action.id in first:
                what = f"'{action.id}' names two steps (the first on line {first[action.id].line})"
                self.findings.report(at, what, "give each its own name")
            elif action.id:
                first[action.id] = action

    def actions(self, actions: tuple[Action, ...], scope: Scope) -> None:
        for action in actions:
            match action:
                case Loop():
                    self._loop(action, scope)
                case If():
                    self._if(action, scope)
                case Step():
                    self._step(action, scope)

    def interlocks(self, conditions: DeviceConditions | None) -> None:
        first: set[str] = set()
        for interlock in self._procedure.interlocks:
            if interlock.id in first:
                self.findings.report((*interlock.at, "id"), f"'{interlock.id}' names two interlocks", "rename one")
            first.add(interlock.id)
            if interlock.device and self._devices is not None:
                self._condition(interlock, conditions)

    def _condition(self, interlock: Interlock, conditions: DeviceConditions | None) -> None:
        device, condition = interlock.device, interlock.condition
        if device not in (self._devices or {}):
            cure = did_you_mean(device, self._devices or {})
            self.findings.report((*interlock.at, "device"), f"the cell has no device '{device}'", cure)
        elif conditions is not None and condition and condition not in conditions.get(device, {}):
            known = ", ".join(sorted(conditions.get(device, {})))
            near = did_you_mean(condition, conditions.get(device, {}), "choose one")
            cure = f"{near}; its conditions: {known}" if known else "its driver offers no conditions"
            what = f"'{device}' has no condition '{condition}'"
            self.findings.report((*interlock.at, "condition"), what, cure)

    def _if(self, action: If, scope: Scope) -> None:
        expression = action.expression
        if expression:
            at = (*action.at, "if")
            kind = kind_of_shape(self._shape(expression.reference, at, scope))
            if kind and kind != expression.takes:
                what = f"{expression.reference} is {kind}, and has to be {expression.takes} here"
                self.findings.report(at, what, EXPRESSION_RULE)
        self.actions(action.then, scope.within())
        self.actions(action.otherwise, scope.within())

    def _loop(self, loop: Loop, scope: Scope) -> None:
        inner = scope.within()
        if loop.variable and loop.variable in scope:
            what = f"the loop's variable '{loop.variable}' hides a {scope.what(loop.variable)} of that name"
            self.findings.report((*loop.at, "as"), what, "give it another name")
        inner.add_variable(loop, self._elements(loop, scope))
        self.actions(loop.steps, inner)

    def _elements(self, loop: Loop, scope: Scope) -> Shape:
        at = (*loop.at, "for_each")
        if not isinstance(loop.for_each, Reference):
            self._references(loop.for_each, at, scope)
            return Any
        shape = self._shape(loop.for_each, at, scope)
        try:
            return element_of(shape)
        except NoSuchPart as error:
            self.findings.report(at, f"'for_each' takes a list; {loop.for_each} is {error.what}", "name a list")
            return Any

    def _step(self, step: Step, scope: Scope) -> None:
        self._references(step.inputs, (*step.at, "with"), scope)
        kind = self._kind(step)
        if kind:
            self._inputs(step, kind, scope)
            self._needs(step, kind)
            self._retry(step, kind)
        if step.id and step.at[0] != "cleanup":
            scope.add_step(step, kind.result if kind else Any)

    def _kind(self, step: Step) -> AnyStepKind | None:
        if not step.do:  # reported when it was read
            return None
        try:
            return self._registry.find(step.do)
        except UnknownStep as error:
            self.findings.report((*step.at, "do"), f"there is no step '{step.do}'", error.cure)
        except BrokenSteps as error:
            self.findings.report((*step.at, "do"), str(error), "mend that package, or install what it misses")
        return None

    def _references(self, value: Any, at: Path, scope: Scope) -> None:
        for place, reference in references_in(value, at):
            self._shape(reference, place, scope)

    def _shape(self, reference: Reference, at: Path, scope: Scope) -> Shape:
        if not reference.name:  # reported when it was read
            return Any
        try:
            return scope.look_up(reference, at).shape
        except Unreachable as error:
            self.findings.report(at, error.what, error.cure)
            return Any

    def _inputs(self, step: Step, kind: AnyStepKind, scope: Scope) -> None:
        at = (*step.at, "with")
        known, unknown = known_part(step.inputs, lambda reference: scope.value_of(reference, at))
        strangers = step.inputs.keys() - kind.input_names()
        known |= dict.fromkeys(strangers)  # there is no such place for any value
        unknown = [path for path in unknown if path[0] not in strangers]
        try:
            kind.read_inputs(known)
        except ValidationError as error:
            self.findings.problems += input_problems(error, self._procedure.document, at, kind, unknown)

    def _needs(self, step: Step, kind: AnyStepKind) -> None:
        if self._devices is None:
            return
        there = {name: protocol for name, protocol in kind.uses.items() if name in self._devices}
        for name, protocol in {**kind.needs, **there}.items():
            what = lacking(name, protocol, self._devices)
            if what and name not in self._devices_named:  # report it once: every touch needs the probe
                self._devices_named.add(name)
                cure = f"add '{name}: <address>' under `devices:`, with a driver that is a {protocol.__name__}"
                self.findings.report((*step.at, "do"), f"step {kind.name} needs {what}", cure)

    def _retry(self, step: Step, kind: AnyStepKind) -> None:
        known = kind.retryable()
        for index, name in enumerate(step.retry.on):
            if name == "DeviceUncertain":
                what = "a step is never tried again after DeviceUncertain: a person has to look first"
                self.findings.report((*step.at, "retry", "on", index), what, "remove it")
            elif name not in known:
                what = f"there is no error '{name}' that {kind.name} could be tried again after"
                self.findings.report((*step.at, "retry", "on", index), what, did_you_mean(name, known))
        if step.retry.attempts > 1 and not step.retry.on:
            cure = "add 'on: [NoContact]' to retry, or remove attempts"
            self.findings.report((*step.at, "retry"), "attempts without an error to try again after", cure)


def lacking(name: str, protocol: type, devices: Devices) -> str:
    """What a cell with `devices` lacks of the device `name` with the abilities `protocol`; empty: nothing."""
    if name not in devices:
        return f"a device '{name}', and the cell has none"
    driver = devices[name]
    missing = missing_abilities(driver, protocol) if driver else []
    return f"'{name}' to be a {protocol.__name__}, and its driver lacks {', '.join(missing)}" if missing else ""


def missing_abilities(driver: type, protocol: type) -> list[str]:
    """Methods and properties of `protocol` that `driver` lacks, sorted.

    Plain attributes are left out: a driver may set them when it is made.
    """
    return sorted(name for name in abilities_of(protocol) if not hasattr(driver, name))


def abilities_of(protocol: type) -> dict[str, Any]:
    """Methods and properties of a Protocol by name, inherited ones too."""
    declared: dict[str, Any] = {}
    for base in reversed(protocol.__mro__):
        if getattr(base, "_is_protocol", False):
            declared |= vars(base)
    return {name: value for name, value in declared.items() if not name.startswith("_") and _does_something(value)}


def _does_something(value: Any) -> bool:
    return callable(value) or isinstance(value, property)


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
