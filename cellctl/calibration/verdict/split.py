"""Rows of the fit, and held-out rows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self, final

import numpy as np

from cellctl.kinematics import Bools


@final
@dataclass(frozen=True, eq=False)
class Split:
    """Rows the model is made from, and pairs (fit, held out) by which it is judged: indices into a task's rows."""

    fit: Any
    judged: tuple[tuple[Any, Any], ...]

    @classmethod
    def by_column(cls, held_out: Bools) -> Self:
        """Rows where `held_out` (N,) is true are held out."""
        fit, test = np.flatnonzero(~held_out), np.flatnonzero(held_out)
        return cls(fit, ((fit, test),) if test.size else ())

    @classmethod
    def holdout(cls, rows: int, fraction: float, seed: int, groups: Sequence[int] | None = None) -> Self:
        """A random share of the rows is held out, those of a group together."""
        number = _numbered(rows, groups)
        order = np.random.default_rng(seed).permutation(number.max(initial=-1) + 1)
        sizes = np.bincount(number)[order]
        chosen = np.zeros(len(order), bool)
        chosen[order] = np.cumsum(sizes) - sizes < round(fraction * rows)
        return cls.by_column(chosen[number])

    @classmethod
    def folds(cls, rows: int, count: int, seed: int, groups: Sequence[int] | None = None) -> Self:
        """The model is made from all rows; each fold is judged by a model made from the others.

        groups (N,): a number for each row; rows of one group are held out together, so that repeats of a measurement do
        not judge a model made from them. Default: each row is its own group.
        """
        number = _numbered(rows, groups)
        order = np.random.default_rng(seed).permutation(number.max(initial=-1) + 1)
        fold = np.empty(len(order), int)
        for place, part in enumerate(np.array_split(order, count)):
            fold[part] = place
        parts = [fold[number] == place for place in range(min(count, len(order)))]
        return cls(np.arange(rows), tuple((np.flatnonzero(~part), np.flatnonzero(part)) for part in parts))

    @classmethod
    def leaving_out(cls, labels: Sequence[str]) -> Self:
        """Made from all rows; the rows of each label in turn are judged by a model made from the others."""
        names, everything = np.array(labels), np.arange(len(labels))
        parts = [np.flatnonzero(names == name) for name in sorted(set(labels))]
        return cls(everything, tuple((np.setdiff1d(everything, part), part) for part in parts if len(parts) > 1))


def _numbered(rows: int, groups: Sequence[int] | None) -> Any:
    """The group of each row (N,), numbered in order of appearance: without repeats the same as without groups."""
    if groups is None:
        return np.arange(rows)
    counted: dict[int, int] = {}
    return np.array([counted.setdefault(group, len(counted)) for group in groups], dtype=int)
