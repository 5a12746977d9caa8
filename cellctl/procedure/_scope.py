"""The names that a step can refer to, and their types, parts and values known before the run."""

from __future__ import annotations

import types
import typing
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Union, final

from pydantic import BaseModel

from cellctl.files import Path
from cellctl.procedure.fields import did_you_mean
from cellctl.procedure.model import Action, Loop, Parameter, ParameterType, Procedure, Step
from cellctl.procedure.references import UNKNOWN, Reference

Shape = Any
"""A type annotation; `Any` if unknown."""


class NoSuchPart(Exception):
    """A value of this type never has such a part. `cure` lists its parts."""

    def __init__(self, what: str, cure: str = "") -> None:
        self.what = what
        self.cure = cure
        super().__init__(what)


def part_of(shape: Shape, part: str | int) -> Shape:
    """The type of a field or element of a value of type `shape`. Raises NoSuchPart if it has none."""
    shape = _plain(shape)
    if shape is Any or _is_mapping(shape):
        return _argument(shape, -1)
    if isinstance(part, int):
        return element_of(shape)
    if isinstance(shape, type) and issubclass(shape, BaseModel):
        return _field(shape, part)
    raise NoSuchPart(f"{_called(shape)} has no field '{part}'")


def element_of(shape: Shape) -> Shape:
    """The type of the elements of a list of type `shape`. Raises NoSuchPart if it is not a list."""
    shape = _plain(shape)
    if shape is Any:
        return Any
    origin = typing.get_origin(shape) or shape
    if not (isinstance(origin, type) and issubclass(origin, Sequence | set | frozenset)) or origin in (str, bytes):
        raise NoSuchPart(f"{_called(shape)} has no elements")
    arguments = typing.get_args(shape)
    if origin is tuple and not (len(arguments) == 2 and arguments[1] is Ellipsis):
        return arguments[0] if len(set(arguments)) == 1 else Any
    return arguments[0] if arguments else Any


def kind_of_shape(shape: Shape) -> str | None:
    """The kind of a value of type `shape`, as `expressions.kind_of` names it; None if unknown."""
    shape = _plain(shape)
    origin = typing.get_origin(shape) or shape
    if shape in _KINDS:
        return _KINDS[shape]
    if isinstance(origin, type) and issubclass(origin, list | tuple | BaseModel | Mapping):
        return "neither flag, number nor text"
    return None


_KINDS: dict[Shape, str] = {bool: "a flag", int: "a number", float: "a number", str: "text"}


def _field(model: type[BaseModel], name: str) -> Shape:
    if name not in model.model_fields:
        raise NoSuchPart(f"{model.__name__} has no field '{name}'", did_you_mean(name, model.model_fields))
    return model.model_fields[name].annotation


def _plain(shape: Shape) -> Shape:
    """The type without `Annotated` and `| None`; other unions stay unchanged."""
    origin: Any = typing.get_origin(shape)
    if origin is Annotated:
        return _plain(typing.get_args(shape)[0])
    if origin in (Union, types.UnionType):
        kinds = [kind for kind in typing.get_args(shape) if kind is not types.NoneType]
        return _plain(kinds[0]) if len(kinds) == 1 else Any
    return shape if origin or isinstance(shape, type) else Any


def _is_mapping(shape: Shape) -> bool:
    origin = typing.get_origin(shape) or shape
    return isinstance(origin, type) and issubclass(origin, Mapping)


def _argument(shape: Shape, index: int) -> Shape:
    arguments = typing.get_args(shape)
    return arguments[index] if arguments else Any


def _called(shape: Shape) -> str:
    words: dict[Any, str] = {int: "a whole number", float: "a number", str: "text", bool: "a flag"}
    origin = typing.get_origin(shape) or shape
    if isinstance(origin, type) and issubclass(origin, list | tuple):
        return "a list"
    return words.get(shape, getattr(shape, "__name__", str(shape)))


_SHAPES = {
    ParameterType.INTEGER: int,
    ParameterType.NUMBER: float,
    ParameterType.TEXT: str,
    ParameterType.FLAG: bool,
}


class Unreachable(Exception):
    """A reference that can never be resolved. `cure`: what to do."""

    def __init__(self, what: str, cure: str = "") -> None:
        self.what = what
        self.cure = cure
        super().__init__(what)


@final
@dataclass(frozen=True, slots=True)
class Name:
    """The meaning of a name: its type, its value if known, and its kind."""

    shape: Shape
    what: str
    value: Any = UNKNOWN


@final
class Scope:
    """The names known at one place of a procedure. `within` creates the inner scope of a loop or branch."""

    def __init__(self, procedure: Procedure, names: Mapping[str, Name]) -> None:
        self._procedure = procedure
        self._names = dict(names)

    @classmethod
    def of_parameters(cls, procedure: Procedure, values: Mapping[str, Any]) -> Scope:
        """The scope at the beginning of a procedure, and of its clean-up."""
        return cls(procedure, {p.name: _parameter(p, values) for p in procedure.parameters.values()})

    def within(self) -> Scope:
        """A scope that begins with the same names."""
        return Scope(self._procedure, self._names)

    def __contains__(self, name: str) -> bool:
        return name in self._names

    def what(self, name: str) -> str:
        """The kind of `name`: `parameter`, `step`, `variable of loop 'points'`."""
        return self._names[name].what

    def add_variable(self, loop: Loop, shape: Shape) -> None:
        """Add the loop's variable."""
        self._names[loop.variable] = Name(shape, f"variable of loop '{loop.id}'")

    def add_step(self, step: Step, result: Shape) -> None:
        """Add the step's result. If a loop variable has the same name, the name resolves to neither."""
        before = self._names.get(step.id)
        doubtful = before is not None and before.what.startswith("variable")
        self._names[step.id] = Name(result, "ambiguous" if doubtful else "step")

    def look_up(self, reference: Reference, at: Path) -> Name:
        """The meaning of `reference`, which is at `at`. Raises Unreachable."""
        name = self._names.get(reference.name)
        if name is None:
            raise self._why_not(reference, at)
        if name.what == "ambiguous":
            what = f"{reference} could be the loop's variable or the result of step '{reference.name}'"
            raise Unreachable(what, "give one of them another name")
        if name.shape is None:
            raise Unreachable(f"step '{reference.name}' gives no result", "remove the reference")
        return _follow(name, reference)

    def value_of(self, reference: Reference, at: Path) -> Any:
        """The value of `reference`, or UNKNOWN."""
        try:
            return self.look_up(reference, at).value
        except Unreachable:
            return UNKNOWN

    def _why_not(self, reference: Reference, at: Path) -> Unreachable:
        name = reference.name
        if at[:1] == ("cleanup",) and name in {action.id for action in self._procedure.actions()}:
            what = f"clean-up cannot use the result of '{name}': it may begin before that step has run"
            return Unreachable(what, "use parameters only")
        for action in self._procedure.actions():
            if action.id == name:
                return _hidden(action, reference, at)
            if isinstance(action, Loop) and action.variable == name:
                what = f"'{name}' is the variable of loop '{action.id}' and is known only inside it"
                return Unreachable(what, "move the step into the loop, or refer to something else")
        return Unreachable(f"{reference}: nothing here is called '{name}'", did_you_mean(name, self._names))


def _hidden(action: Action, reference: Reference, at: Path) -> Unreachable:
    name, around = action.id, action.at[:-1]
    if not isinstance(action, Step):
        kind = "a loop" if isinstance(action, Loop) else "no step"
        return Unreachable(f"'{name}' is {kind} and has no result", "refer to a step before it, or record rows in it")
    if at[: len(action.at)] == action.at:
        return Unreachable(f"step '{name}' refers to its own result", "refer to an earlier step")
    if at[: len(around)] == around or action.at[0] == "cleanup":
        what = f"{reference} refers to step '{name}', which comes later (line {action.line})"
        return Unreachable(what, f"move step '{name}' before this one")
    return Unreachable(
        f"the result of '{name}' stays inside its loop or 'if'", "record rows there, and read them in the step"
    )


def _parameter(parameter: Parameter, values: Mapping[str, Any]) -> Name:
    return Name(_SHAPES[parameter.type], "parameter", values.get(parameter.name, UNKNOWN))


def _follow(name: Name, reference: Reference) -> Name:
    shape = name.shape
    for part in reference.way:
        try:
            shape = part_of(shape, part)
        except NoSuchPart as error:
            raise Unreachable(f"{reference}: {error.what}", error.cure) from error
    return Name(shape, name.what, UNKNOWN if reference.way else name.value)
