"""Effects as plain settings, and back: a model file holds the fields of an effect's class."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import Field, fields
from typing import Any, get_args, get_origin, get_type_hints

import numpy as np

from cellctl.calibration.effects import Effect, kinds
from cellctl.calibration.model.effect import STORED, WITH_DEFAULT

KIND = "kind"


def settings_of(effect: Effect) -> dict[str, Any]:
    """The settings of an effect as plain values, its group under `kind`."""
    stored = (each for each in _fields(type(effect)) if _is_stored(each, getattr(effect, each.name)))
    return {KIND: effect.group, **{_key(each): _plain(getattr(effect, each.name)) for each in stored}}


def effect_of(settings: Mapping[str, Any]) -> Effect:
    """The effect with these settings; one that is missing has its default.

    Raises ValueError for an unknown kind, an unknown or missing setting, or a value of another type.
    """
    kind = kinds().get(settings.get(KIND, ""))
    if kind is None:
        raise ValueError(f"'{settings.get(KIND)}' is no kind of effect; known: {', '.join(kinds())}")
    types, by_key = get_type_hints(kind), {_key(each): each for each in _fields(kind)}
    if unknown := [key for key in settings if key not in by_key and key != KIND]:
        raise ValueError(f"{kind.group} has no setting '{unknown[0]}'")
    values = {}
    for key, each in by_key.items():
        if key in settings:
            values[each.name] = _read(settings[key], types[each.name], f"{kind.group}.{key}")
    try:
        return kind(**values)
    except TypeError:
        raise ValueError(f"{kind.group} lacks a setting: it has {', '.join(by_key)}") from None


def _fields(kind: type[Effect]) -> list[Field[Any]]:
    return [each for each in fields(kind) if each.init]  # type: ignore[arg-type]  # every effect is a dataclass


def _is_stored(field: Field[Any], value: Any) -> bool:
    return bool(field.metadata.get(WITH_DEFAULT, True) or value != field.default)


def _key(field: Field[Any]) -> str:
    return str(field.metadata.get(STORED, field.name))


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, frozenset):
        return sorted(value)
    return [_plain(each) for each in value] if isinstance(value, tuple) else value


def _read(value: Any, kind: Any, where: str) -> Any:
    """`value` as the type `kind`: a number, a tuple, a frozenset, or an array of rows of equal length."""
    origin, parts = get_origin(kind), get_args(kind)
    if origin is np.ndarray:
        rows = [_read(row, tuple[float, ...], where) for row in _listed(value, where)]
        if not rows or len({len(row) for row in rows}) > 1:
            raise ValueError(f"{where} is no table of numbers with rows of equal length")
        return np.array(rows)
    if origin is frozenset:
        return frozenset(_read(each, parts[0], where) for each in _listed(value, where))
    if origin is tuple:
        given = _listed(value, where)
        of_each = [parts[0]] * len(given) if parts[-1] is Ellipsis else list(parts)
        if len(of_each) != len(given):
            raise ValueError(f"{where} has {len(given)} values, and {len(of_each)} belong there")
        return tuple(_read(each, part, where) for each, part in zip(given, of_each, strict=True))
    if kind is float and type(value) in (int, float) and math.isfinite(value):
        return float(value)
    if kind is not float and type(value) is kind:
        return value
    raise ValueError(f"{where}: {value!r} is no {kind.__name__}")


def _listed(value: Any, where: str) -> list[Any]:
    if not isinstance(value, list | tuple):
        raise ValueError(f"{where}: {value!r} is no list")
    return list(value)
