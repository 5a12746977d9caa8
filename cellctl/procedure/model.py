"""A procedure as data: actions, their order, inputs, and the place of a step; nothing is run here."""

from __future__ import annotations

import pathlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, final

from cellctl.files import Document, Path, Problem
from cellctl.procedure.references import Expression, Reference, resolve

Value = Any
"""JSON with `Reference`s as leaves, as written under `with:`."""


class ParameterType(StrEnum):
    """What kind of value a parameter takes."""

    INTEGER = "integer"
    NUMBER = "number"
    TEXT = "text"
    FLAG = "flag"


@final
@dataclass(frozen=True, slots=True)
class Parameter:
    """A value that the operator may set. `default` None: it is required. `at`: its place in the document."""

    name: str
    type: ParameterType
    default: int | float | str | bool | None = None
    min: float | None = None
    max: float | None = None
    choices: tuple[str, ...] = ()
    unit: str = ""
    help: str = ""
    at: Path = ()


class OnResume(StrEnum):
    """How a resumed run treats a finished step."""

    SKIP = "skip"
    ALWAYS = "always"


@final
@dataclass(frozen=True, slots=True)
class Retry:
    """Total number of attempts at a step (`attempts` ≥ 1), and the errors that are retried (class names)."""

    attempts: int = 1
    on: tuple[str, ...] = ()


@final
@dataclass(frozen=True, slots=True)
class Step:
    """One step: `do` names its kind, `inputs` are the values under `with:`, references unresolved.

    `timeout_s` in seconds of the cell's time, None for none. `at`, `line`, `column`: its place in the file.
    """

    id: str
    do: str
    inputs: dict[str, Value]
    timeout_s: float | None
    retry: Retry
    on_resume: OnResume
    at: Path
    line: int
    column: int


@final
@dataclass(frozen=True, slots=True)
class Loop:
    """Steps done once for each element of a list (`for_each`: a reference or the list), named `variable` inside.

    `title`: shown to the operator while its steps run; empty: the titles of the steps.
    """

    id: str
    for_each: Reference | list[Value]
    variable: str
    steps: tuple[Action, ...]
    at: Path
    line: int
    column: int
    title: str = ""


@final
@dataclass(frozen=True, slots=True)
class Confirm:
    """The run waits until the operator confirms `text`; `timeout_s` in seconds of the cell's time, None for none."""

    id: str
    text: str
    timeout_s: float | None
    on_resume: OnResume
    at: Path
    line: int
    column: int


@final
@dataclass(frozen=True, slots=True)
class If:
    """Steps done where `expression` is true (`then`), or where it is not (`otherwise`). None: unreadable."""

    id: str
    expression: Expression | None
    then: tuple[Action, ...]
    otherwise: tuple[Action, ...]
    at: Path
    line: int
    column: int


Action = Step | Loop | Confirm | If


class OnBreak(StrEnum):
    """The reaction of an interlock when its condition no longer holds."""

    STOP = "stop"
    """Stop the step in progress and pause; the step is repeated afterwards."""
    PAUSE = "pause"
    """Pause before the next step."""
    ABORT = "abort"
    """Abort the run, with its clean-up."""


class Resume(StrEnum):
    """What ends the pause of an interlock once its condition holds again."""

    OPERATOR = "operator"
    AUTO = "auto"


@final
@dataclass(frozen=True, slots=True)
class Interlock:
    """A condition of a device that must hold while the steps run, and the reaction when it does not."""

    id: str
    device: str
    condition: str
    on_break: OnBreak = OnBreak.STOP
    resume: Resume = Resume.OPERATOR
    at: Path = ()


@final
@dataclass(frozen=True)
class Procedure:
    """A procedure file. `cell` is its default cell's path, joined to the procedure's folder.

    `problems`: the errors from reading it. The readable part is kept, so that `check`
    can report the other errors with them. A procedure with problems must not be run.
    """

    document: Document
    name: str
    title: str
    cell: pathlib.Path | None
    parameters: dict[str, Parameter]
    steps: tuple[Action, ...]
    cleanup: tuple[Step, ...]
    interlocks: tuple[Interlock, ...] = ()
    problems: tuple[Problem, ...] = field(default=())

    @property
    def text(self) -> str:
        """The file as it was read."""
        return self.document.text

    def actions(self) -> Iterator[Action]:
        """All actions, clean-up too, each loop and `if` before its steps, in the order of the file."""
        return walk((*self.steps, *self.cleanup))


def walk(actions: tuple[Action, ...]) -> Iterator[Action]:
    """`actions` and all actions inside their loops and branches, depth first."""
    for action in actions:
        yield action
        if isinstance(action, Loop):
            yield from walk(action.steps)
        elif isinstance(action, If):
            yield from walk((*action.then, *action.otherwise))


def step_path(outer: str, name: str, index: int | None = None) -> str:
    """A step's identity inside `outer`: `step_path("", "points", 17)` is `points[17]`, and in it `points[17].touch`."""
    place = f"{outer}.{name}" if outer else name
    return place if index is None else f"{place}[{index}]"


def step_at(
    procedure: Procedure, path: str, parameters: Mapping[str, Any], finished: Mapping[str, Any]
) -> tuple[Step, dict[str, Any]]:
    """The step at `path` (`points[17].touch`), and the values that it can refer to: name → JSON.

    parameters: their values; finished: path → result of the steps that are done, and of the `if`s that are decided.
    Raises LookupError if the procedure has no such step, or an `if` around it is not decided.
    """
    scope, outer = dict(parameters), ""
    actions: tuple[Action, ...] = procedure.steps
    first, _, rest = path.partition(".")
    if first == "cleanup" and rest and all(action.id != first for action in actions):
        actions, path, outer = procedure.cleanup, rest, first
    for part in path.split("."):
        name, _, index = part.rstrip("]").partition("[")
        action = _found(actions, name, outer, finished, scope)
        outer = step_path(outer, part)
        if isinstance(action, Step):
            return action, scope
        if isinstance(action, Loop):
            scope[action.variable] = resolve(action.for_each, scope)[int(index)]
            actions = action.steps
        if isinstance(action, If):
            actions = action.then if finished[outer]["value"] else action.otherwise
    raise LookupError(f"{path} is no step")


def _found(
    actions: tuple[Action, ...], name: str, outer: str, finished: Mapping[str, Any], scope: dict[str, Any]
) -> Action:
    """The action called `name`; the results of the steps before it are added to `scope`."""
    for action in actions:
        if action.id == name:
            return action
        path = step_path(outer, action.id)
        if isinstance(action, Step) and path in finished:
            scope[action.id] = finished[path]
    raise LookupError(f"there is no '{name}' in the procedure")
