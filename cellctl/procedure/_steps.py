"""Step kinds: an async function with its inputs, result and devices; the interface through which it works."""

from __future__ import annotations

import inspect
import pathlib
import re
import typing
from collections.abc import Awaitable, Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import NoneType
from typing import Any, Generic, Protocol, TypeVar, final

from pydantic import BaseModel, ConfigDict

from cellctl.clock import Clock
from cellctl.devices import DeviceUncertain, Identity, acts
from cellctl.devices import errors as device_errors
from cellctl.files import Document, canonical_json
from cellctl.records import AnyRow, Row, VerdictRow


class StepContext(Protocol):
    """The engine's side of a step: devices, time, the run so far, and the journal."""

    @property
    def step(self) -> str:
        """The step's identity, `points[17].touch`."""

    @property
    def attempt(self) -> int:
        """Which attempt this is, from 1; a resumed run goes on counting."""

    @property
    def clock(self) -> Clock:
        """The cell's time."""

    @property
    def seed(self) -> int:
        """The run's seed; all that is random in a step follows from it and the step's identity."""

    @property
    def runs(self) -> pathlib.Path:
        """The folder of the runs."""

    @property
    def run_folder(self) -> pathlib.Path:
        """Where the run's files are. To write one: `write_artefact`; to read one: `artefact`."""

    @property
    def run_name(self) -> str:
        """The run's name at its start, also after its folder moved."""

    @property
    def operator(self) -> str:
        """The person who started the run or resumed it last."""

    @property
    def calendar(self) -> str:
        """When the run began or was last resumed, UTC, ISO 8601: a label, from the journal."""

    @property
    def cell(self) -> Document:
        """The cell file, with the places of its values; paths in it are relative to its folder."""

    @property
    def robot_file(self) -> pathlib.Path:
        """The robot file that the cell names."""

    def device(self, name: str) -> Any:
        """The connected device of that name: `robot: SearchingRobot = context.device("robot")`.

        A step gets what it declared in `needs`; KeyError for anything else.
        """

    def optional_device(self, name: str) -> Any | None:
        """The connected device of that name that the step declared in `uses`; None if the cell has none.

        KeyError for anything else.
        """

    def identity(self, name: str) -> Identity:
        """The identity that device `name` reported when this run connected it. Needs no device. Raises InputError."""

    async def record(self, row: Row) -> None:
        """Commit a row to the journal; once this returns, the row survives a crash.

        Raises ValueError for values outside JSON (NaN included), and the journal's error if it cannot write.
        """

    async def write_artefact(self, name: str, content: str | bytes) -> str:
        """Write a file into the run folder, whole or not at all, and record its hash; the SHA-256 (hex).

        Raises OSError, and what `record` raises.
        """

    def artefact(self, name: str) -> pathlib.Path:
        """A file that this run wrote with `write_artefact`, to be read.

        Raises InputError if it is missing, or not as this run wrote it.
        """

    def recorded(self, kind: type[AnyRow]) -> Sequence[AnyRow]:
        """The rows of this class that count: those of finished steps, and of this attempt, in the order of recording.

        Raises InputError, naming event, kind and field, if the journal's data do not fit the class.
        """

    def all_recorded(self, *kinds: type[AnyRow]) -> Sequence[AnyRow]:
        """The rows of these classes of every attempt, failed and interrupted ones included, in order."""

    def say(self, text: str) -> None:
        """One line of progress for the operator."""


class CellContext(Protocol):
    """The data before a run and in a step: the cell's file, its robot file, the run's seed, the folder of the runs."""

    @property
    def cell(self) -> Document:
        """The cell file, with the places of its values."""

    @property
    def robot_file(self) -> pathlib.Path:
        """The robot file that the cell names."""

    @property
    def seed(self) -> int:
        """The run's seed."""

    @property
    def runs(self) -> pathlib.Path:
        """The folder of the runs."""


CheckCell = Callable[[CellContext, Mapping[str, Any]], None]
"""`check(context, known)`: raises InputError for what the step would refuse in the run. `known`: inputs by name that
follow from the parameters and defaults; each is of its type only where the step's model is satisfied."""


ExpectedPasses = Callable[[Mapping[str, Any]], int]
"""`expects(known)`: number of passes of later loops from the step's result; 0: unknown."""


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


@final
@dataclass(frozen=True, slots=True)
class StepDescription:
    """What the status of a run needs of a step kind whose function is not imported yet.

    `module`: of the function, `.name` inside the family's package. `title`, `inputs`, `expects`: as of `StepKind`;
    `inputs` only with `expects`, for the defaults.
    """

    name: str
    module: str
    title: str = ""
    inputs: type[BaseModel] = NoInputs
    expects: ExpectedPasses | None = None


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
