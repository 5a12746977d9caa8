"""The parts of a value by its type, for checks before the run."""

from __future__ import annotations

import types
import typing
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Union

from pydantic import BaseModel

from cellctl.procedure.suggest import did_you_mean

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
