"""Statements of a paper beside our numbers: figures, and orderings, over several simulated robots, and their tables.

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

FIGURES = "| figure | paper | ours | note |\n|---|---|---|---|"
ORDERINGS = (
    "| ordering | paper | less | more | difference | holds | restored by | note |\n|---|---|---|---|---|---|---|---|"
)


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


def page_of(paper: Paper, results: Results) -> str:
    """All tables of a paper."""
    seeds = len(results.by_seed)
    head = f"Means of {seeds} simulated robots (seeds) with their 95 % confidence intervals."
    return "\n\n".join([head, *(_section(section, results) for section in paper.sections)])


def _section(section: Section, results: Results) -> str:
    figures = [_figure(one, results) for one in section.statements if isinstance(one, Figure)]
    orderings = [_ordering(one, results) for one in section.statements if isinstance(one, Ordering)]
    parts = [f"### {section.title}"]
    parts += ["\n".join([FIGURES, *figures])] if figures else []
    parts += ["\n".join([ORDERINGS, *orderings])] if orderings else []
    return "\n\n".join(parts)


def _figure(figure: Figure, results: Results) -> str:
    ours = results.interval(figure.key).text(figure.digits)
    return f"| {figure.text} | {figure.paper or '–'} | {ours} | {figure.note} |"


def _ordering(ordering: Ordering, results: Results) -> str:
    found, digits = results.outcome(ordering), ordering.digits
    cells = [
        ordering.text,
        ordering.paper,
        found.less.text(digits),
        found.more.text(digits),
        found.difference.text(digits),
        f"{found.holds} ({found.seeds_for} of {found.seeds})",
        _restored(ordering, found, results),
        ordering.note,
    ]
    return "| " + " | ".join(cells) + " |"


def _restored(ordering: Ordering, found: Outcome, results: Results) -> str:
    """The switches under which the ordering holds, where it does not in the cell's own World."""
    if found.holds == "yes":
        return "–"
    outcomes = {world: results.outcome(ordering, world) for world in ordering.worlds}
    restoring = [
        f"`{world}` ({one.difference.text(ordering.digits)})" for world, one in outcomes.items() if one.holds == "yes"
    ]
    if restoring:
        return ", ".join(restoring)
    return f"none of {', '.join(f'`{world}`' for world in outcomes)}" if outcomes else "no switch tried"
