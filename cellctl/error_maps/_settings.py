"""Settings of an error map that is a term of a model, `kriging:weights=searched,lambda=rows`; and its inputs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, TypeAlias, TypeVar

import numpy as np

from cellctl.kinematics import Floats, SerialChain

T = TypeVar("T")

Settings: TypeAlias = Mapping[str, tuple[str, Callable[[str], Any]]]
"""Of a method: each key with its default word, and what a word means; the meaning raises ValueError with the possible
values."""

SPACES = ("joints", "position", "pose")
"""Inputs of a map: the joint angles; where the nominal robot's TCP would be; that and its orientation."""


def inputs(space: str, nominal: SerialChain, q: Floats) -> Floats:
    """Inputs (N, k) at model angles q (N, n), rad, of the nominal robot in its own base frame.

    Joints (n), rad; position (3), mm; pose (9): the position, and the x and y axis of the TCP: without the jumps that
    angles have.
    """
    if space == "joints":
        return q
    poses = nominal.forward(q)
    if space == "position":
        return np.asarray(poses[:, :3, 3])
    return np.hstack([poses[:, :3, 3], poses[:, :3, 0], poses[:, :3, 1]])


def one_of(*values: str) -> Callable[[str], str]:
    """A word out of these."""

    def meaning(word: str) -> str:
        if word not in values:
            raise ValueError(f"one of {', '.join(values)}")
        return word

    return meaning


def number(low: float, high: float) -> Callable[[str], float]:
    """A number in this range."""

    def meaning(word: str) -> float:
        try:
            value = float(word)
        except ValueError:
            value = np.nan
        if not low <= value <= high:
            raise ValueError(f"a number from {low:g} to {high:g}")
        return value

    return meaning


def whole(low: int, high: int) -> Callable[[str], int]:
    """A whole number in this range."""

    def meaning(word: str) -> int:
        if not word.isdecimal() or not low <= int(word) <= high:
            raise ValueError(f"a whole number from {low} to {high}")
        return int(word)

    return meaning


def by_rows(other: Callable[[str], T]) -> Callable[[str], T | None]:
    """`rows`, which leaves the choice to the rows of the fit (None), or something else."""

    def meaning(word: str) -> T | None:
        try:
            return None if word == "rows" else other(word)
        except ValueError as error:
            raise ValueError(f"rows, or {error}") from None

    return meaning


def layers(word: str) -> tuple[int, ...]:
    """Hidden layers: `16`, or `32-16`."""
    units = tuple(int(each) for each in word.split("-") if each.isdecimal())
    if len(units) != word.count("-") + 1 or not all(1 <= each <= 512 for each in units) or len(units) > 4:
        raise ValueError("units of one to four layers, as 16 or 32-16")
    return units


def values_of(settings: Settings, words: str) -> dict[str, Any]:
    """What all settings mean: those of `key=value,…`, the others by their defaults. Raises ValueError with the cure."""
    given: dict[str, str] = {}
    for part in words.split(",") if words else ():
        key, equals, value = part.partition("=")
        if key not in settings:
            raise ValueError(f"it has no setting '{key}', but {', '.join(settings)}")
        if not equals or key in given:
            raise ValueError(f"'{part}': write each setting once, as KEY=VALUE")
        given[key] = value
    found = {}
    for key, (default, meaning) in settings.items():
        word = given.get(key, default)
        try:
            found[key] = meaning(word)
        except ValueError as error:
            raise ValueError(f"{key}={word}: give {error}") from None
    return found
