"""All errors of a procedure, before any motion: structure, names, references, steps, inputs, devices, settings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, final

from pydantic import ValidationError

from cellctl.files import InputError, Path, Problem
from cellctl.procedure.abilities import missing_abilities
from cellctl.procedure.expressions import EXPRESSION_RULE
from cellctl.procedure.fields import Findings
from cellctl.procedure.inputs import input_problems
from cellctl.procedure.model import Action, If, Interlock, Loop, Procedure, Step
from cellctl.procedure.parameters import read_settings
from cellctl.procedure.references import Reference, known_part, references_in
from cellctl.procedure.registry import BrokenSteps, StepRegistry, UnknownStep
from cellctl.procedure.scope import Scope, Unreachable
from cellctl.procedure.shapes import NoSuchPart, Shape, element_of, kind_of_shape
from cellctl.procedure.steps import AnyStepKind
from cellctl.procedure.suggest import did_you_mean

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
