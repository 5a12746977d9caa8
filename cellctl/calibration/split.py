"""Which rows a model is made from, and which judge it."""

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
        """Rows where `held_out` (N,) is true are for judging alone."""
        fit, test = np.flatnonzero(~held_out), np.flatnonzero(held_out)
        return cls(fit, ((fit, test),) if test.size else ())

    @classmethod
    def holdout(cls, rows: int, fraction: float, seed: int) -> Self:
        """A random share of the rows is held out."""
        held_out = np.zeros(rows, bool)
        held_out[np.random.default_rng(seed).permutation(rows)[: round(fraction * rows)]] = True
        return cls.by_column(held_out)

    @classmethod
    def folds(cls, rows: int, count: int, seed: int) -> Self:
        """The model is made from all rows; each fold is judged by a model made from the others."""
        order = np.random.default_rng(seed).permutation(rows)
        parts = [np.sort(part) for part in np.array_split(order, count)]
        everything = np.arange(rows)
        return cls(everything, tuple((np.setdiff1d(everything, part), part) for part in parts if part.size))

    @classmethod
    def leaving_out(cls, labels: Sequence[str]) -> Self:
        """Made from all rows; the rows of each label in turn are judged by a model made from the others."""
        names, everything = np.array(labels), np.arange(len(labels))
        parts = [np.flatnonzero(names == name) for name in sorted(set(labels))]
        return cls(everything, tuple((np.setdiff1d(everything, part), part) for part in parts if len(parts) > 1))
