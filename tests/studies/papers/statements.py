"""Statements of a paper beside our numbers: figures, and orderings, over several simulated robots.

A study gives one dictionary of numbers for each seed. A key is a name, `held_out_mean`; the same number in a World with
another switch has the switch before it, `gear: 1/held_out_mean`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeAlias, final

import numpy as np
from numpy.typing import NDArray
from scipy import stats

Numbers: TypeAlias = dict[str, float]
"""Key → number of one seed."""

Study: TypeAlias = Callable[[int], Numbers]
"""The numbers of one seed."""


@final
@dataclass(frozen=True, slots=True)
class Interval:
    """Mean of n seeds, and half of its 95 % confidence interval (Student's t; 0 for one seed)."""

    mean: float
    half: float

    @classmethod
    def of(cls, values: Sequence[float] | NDArray[np.float64]) -> Interval:
        """Of one value for each seed."""
        array = np.asarray(values, float)
        if len(array) < 2:
            return cls(float(array.mean()), 0.0)
        half = stats.t.ppf(0.975, len(array) - 1) * array.std(ddof=1) / np.sqrt(len(array))
        return cls(float(array.mean()), float(half))

    def text(self, digits: int) -> str:
        """`0.123 ± 0.004`."""
        return f"{round(self.mean, digits) + 0.0:.{digits}f} ± {self.half:.{digits}f}"


@final
@dataclass(frozen=True, slots=True)
class Figure:
    """A number of the paper, as text, beside ours. `key`: of the study's numbers. `note`: why they differ, if so."""

    text: str
    paper: str
    key: str
    digits: int = 3
    note: str = ""


@final
@dataclass(frozen=True, slots=True)
class Ordering:
    """A statement of the paper that one number is less than another. `paper`: with its figures, as text.

    `worlds`: switches of the World under which both numbers are there too, to see what restores the ordering.
    """

    text: str
    paper: str
    less: str
    more: str
    digits: int = 3
    worlds: tuple[str, ...] = ()
    note: str = ""


@final
@dataclass(frozen=True, slots=True)
class Outcome:
    """What the seeds say of an ordering. holds: by the 95 % interval of the mean difference `more` − `less`."""

    less: Interval
    more: Interval
    difference: Interval
    seeds_for: int
    seeds: int
    holds: Literal["yes", "no", "not decided"]


@final
@dataclass(frozen=True, slots=True)
class Section:
    """A heading with its statements."""

    title: str
    statements: tuple[Figure | Ordering, ...]


@final
@dataclass(frozen=True, eq=False)
class Paper:
    """A paper's study. `tag`: as on the command line and in the page's marks. `cell`: the cell file of its World."""

    tag: str
    title: str
    cell: Path
    study: Study
    sections: tuple[Section, ...]


@final
@dataclass(frozen=True, eq=False)
class Results:
    """Numbers by seed."""

    by_seed: Mapping[int, Numbers]

    def values(self, key: str) -> NDArray[np.float64]:
        """One number for each seed (S,), in the order of the seeds. Raises KeyError: no seed has it."""
        return np.array([self.by_seed[seed][key] for seed in sorted(self.by_seed)])

    def interval(self, key: str) -> Interval:
        """Mean and confidence interval."""
        return Interval.of(self.values(key))

    def outcome(self, ordering: Ordering, world: str = "") -> Outcome:
        """Whether the ordering comes out; `world`: under this switch."""
        less, more = (self.values(under(world, key)) for key in (ordering.less, ordering.more))
        difference = Interval.of(more - less)
        decided = abs(difference.mean) > difference.half
        return Outcome(
            less=Interval.of(less),
            more=Interval.of(more),
            difference=difference,
            seeds_for=int(np.count_nonzero(less < more)),
            seeds=len(less),
            holds=("yes" if difference.mean > 0.0 else "no") if decided else "not decided",
        )

    @classmethod
    def of(cls, rows: Iterable[Mapping[str, Any]], tag: str) -> Results:
        """Those of a paper, from rows of all."""
        return cls({row["seed"]: row["numbers"] for row in rows if row["paper"] == tag})


def under(world: str, key: str) -> str:
    """The key of a number in the World with a switch; the cell's own World has none."""
    return f"{world}/{key}" if world else key


def numbers_under(world: str, numbers: Numbers) -> Numbers:
    """All these numbers with the switch before their keys."""
    return {under(world, key): number for key, number in numbers.items()}
