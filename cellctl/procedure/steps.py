"""Step kinds: an async function with its inputs, result and devices, known before it runs."""

from __future__ import annotations

import inspect
import re
import typing
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass, field
from types import NoneType
from typing import Any, Generic, TypeVar, final

from pydantic import BaseModel, ConfigDict

from cellctl.devices import DeviceUncertain, acts
from cellctl.devices import errors as device_errors
from cellctl.files import canonical_json
from cellctl.procedure.cell_check import CheckCell, ExpectedPasses
from cellctl.procedure.context import StepContext
from cellctl.records import VerdictRow

Inputs = TypeVar("Inputs", bound=BaseModel)
Result = TypeVar("Result", bound="BaseModel | None")

_KIND = re.compile(r"[a-z][a-z0-9_]*\.[a-z][a-z0-9_]*")


class StepInputs(BaseModel):
    """Base class of a step's inputs: unknown inputs are errors, text is never converted."""

    model_config = ConfigDict(extra="forbid", frozen=True)


@final
class NoInputs(StepInputs):
    """The inputs of a step without inputs."""


class StepResult(BaseModel):
    """Base class of a step's result for later steps; stored in the journal as JSON."""

    model_config = ConfigDict(extra="forbid", frozen=True)


@final
@dataclass(frozen=True, slots=True)
class StepKind(Generic[Inputs, Result]):
    """A step kind, callable as its function.

    `needs`: device name → the Protocol required of it. `uses`: the same for devices that a cell may lack. `moves`: it
    has a device that moves or writes (`cellctl.devices.acts`), so that a crash in it leaves an uncertain state.
    `errors`: errors of its own, by class name, that `retry.on` may name. `check`: raises what the step would refuse of
    the cell, before the run. `verdict`: the row that it records, if it records the verdict of a campaign. `title`:
    shown to the operator while it runs. `expects`: see `ExpectedPasses`. `reads_files`: it reads files outside the
    run folder, and records what it read.
    """

    name: str
    summary: str
    inputs: type[Inputs]
    result: type[BaseModel] | None
    needs: Mapping[str, type]
    moves: bool
    function: Callable[[StepContext, Inputs], Awaitable[Result]]
    errors: Mapping[str, type[Exception]] = field(default_factory=dict)
    check: CheckCell | None = None
    title: str = ""
    expects: ExpectedPasses | None = None
    verdict: type[VerdictRow] | None = None
    uses: Mapping[str, type] = field(default_factory=dict)
    reads_files: bool = False

    @property
    def computes(self) -> bool:
        """Whether it uses no device or other file: its result depends on the journal alone, and can be replayed."""
        return not (self.needs or self.uses or self.moves or self.reads_files)

    async def __call__(self, context: StepContext, inputs: Inputs) -> Result:
        """Do the step."""
        return await self.function(context, inputs)

    def input_names(self) -> set[str]:
        """The names allowed under `with:`."""
        return {field.alias or name for name, field in self.inputs.model_fields.items()}

    def read_inputs(self, values: Mapping[str, Any]) -> Inputs:
        """The step's inputs from JSON values, strictly. Raises pydantic.ValidationError.

        They pass through JSON, so that values computed in this run and values from the journal are equal.
        """
        return self.inputs.model_validate_json(canonical_json(dict(values)), strict=True)

    def dump_result(self, result: BaseModel | None) -> dict[str, Any] | None:
        """A result as JSON, for the journal and for references of later steps."""
        return None if result is None else result.model_dump(mode="json")

    def retryable(self) -> dict[str, type[Exception]]:
        """Every error that `retry.on` may name, by name: the devices' errors, a time-out, and the step's own.

        `DeviceUncertain` is not included: a person must check the cell before any further motion.
        """
        errors = {name: error for name, error in self.errors.items() if not issubclass(error, DeviceUncertain)}
        return {**_DEVICE_ERRORS, "TimeoutError": TimeoutError, **errors}


AnyStepKind = StepKind[Any, Any]

_DEVICE_ERRORS: dict[str, type[Exception]] = {
    name: value
    for name, value in vars(device_errors).items()
    if isinstance(value, type)
    and issubclass(value, device_errors.DeviceError)
    and not issubclass(value, DeviceUncertain)
}


def step(
    name: str,
    *,
    needs: Mapping[str, type] | None = None,
    uses: Mapping[str, type] | None = None,
    moves: bool = False,
    errors: tuple[type[Exception], ...] = (),
    check: CheckCell | None = None,
    title: str = "",
    expects: ExpectedPasses | None = None,
    verdict: type[VerdictRow] | None = None,
    reads_files: bool = False,
) -> Callable[[Callable[[StepContext, Inputs], Awaitable[Result]]], StepKind[Inputs, Result]]:
    """Make a step kind from `async def name(context, inputs: Model) -> Result | None`.

    `name` is `family.verb`, where the family is the entry point (group `cellctl.steps`) of its module.
    The docstring's first line is its summary. It moves or writes if a device's Protocol does (`cellctl.devices.acts`):
    ask for the narrowest one; `moves`: it does by something else than a device. `uses`, `check`, `title`, `expects`,
    `reads_files`: see `StepKind`. Raises TypeError if the function does not fit.
    """

    def make(function: Callable[[StepContext, Inputs], Awaitable[Result]]) -> StepKind[Inputs, Result]:
        inputs, result = _signature(name, function)
        for what, hook, given in (("check", check, 2), ("expects", expects, 1)):
            if hook is not None:
                _callable_with(name, what, hook, given)
        return StepKind(
            name=name,
            summary=_summary(name, function),
            inputs=inputs,
            result=result,
            needs=dict(needs or {}),
            uses=dict(uses or {}),
            moves=moves or any(map(acts, (*(needs or {}).values(), *(uses or {}).values()))),
            function=function,
            errors={error.__name__: error for error in errors},
            check=check,
            title=title,
            expects=expects,
            verdict=verdict,
            reads_files=reads_files,
        )

    return make


def _callable_with(name: str, what: str, hook: object, given: int) -> None:
    """Raise TypeError unless `hook`, the step's `check=` or `expects=`, can be called with so many arguments."""
    try:
        inspect.signature(hook).bind(*[None] * given)  # type: ignore[arg-type]  # a wrong one is what is looked for
    except TypeError as error:
        takes = "(context, known)" if given == 2 else "(known)"
        raise TypeError(f"step '{name}': `{what}=` has to be a function of {takes}: {error}") from error


def _signature(name: str, function: Callable[..., Any]) -> tuple[type[Any], type[BaseModel] | None]:
    if not _KIND.fullmatch(name):
        raise TypeError(f"'{name}' is no name for a kind of step (family.verb)")
    if not inspect.iscoroutinefunction(function):
        raise TypeError(f"step '{name}' has to be an async function")
    hints = typing.get_type_hints(function)
    parameters = list(inspect.signature(function).parameters)
    inputs = hints.get(parameters[1]) if len(parameters) == 2 else None
    if not _is_model(inputs) or inputs.model_config.get("extra") != "forbid":
        raise TypeError(f"step '{name}' has to take (context, inputs: a model derived from StepInputs)")
    result = hints.get("return", Any)
    if result is NoneType:
        return inputs, None
    if not _is_model(result):
        raise TypeError(f"step '{name}' has to return a model derived from StepResult, or None")
    return inputs, result


def _is_model(value: Any) -> typing.TypeGuard[type[BaseModel]]:
    return isinstance(value, type) and issubclass(value, BaseModel)


def _summary(name: str, function: Callable[..., Any]) -> str:
    text = inspect.getdoc(function)
    if not text:
        raise TypeError(f"step '{name}' has no docstring; its first line is what the operator reads")
    return text.splitlines()[0]
