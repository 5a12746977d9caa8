"""Statements of a paper beside our numbers: figures, and orderings, over several simulated robots, and their tables.

A study gives one dictionary of numbers for each seed. A key is a name, `held_out_mean`; the same number in a World with
another switch has the switch before it, `gear: 1/held_out_mean`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
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
    "| ordering | paper | less | more | difference | holds | otherwise with | note |\n|---|---|---|---|---|---|---|---|"
)
LEVEL = 0.05
"""Probability that a page of statements none of which is true or false says "yes" or "no" of any."""

Holds: TypeAlias = Literal["yes", "no", "not decided"]


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

    `worlds`: switches of the World under which both numbers are there too, to see what restores or reverses it.
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
    """What the seeds say of an ordering. p: two-sided, of Student's t for the mean difference `more` − `less`."""

    less: Interval
    more: Interval
    difference: Interval
    seeds_for: int
    seeds: int
    p: float

    def holds(self, level: float) -> Holds:
        """Decided where p is below the level."""
        if self.p >= level:
            return "not decided"
        return "yes" if self.difference.mean > 0.0 else "no"


@final
@dataclass(frozen=True, slots=True)
class Section:
    """A heading with its statements."""

    title: str
    statements: tuple[Figure | Ordering, ...]


@final
@dataclass(frozen=True, eq=False)
class Paper:
    """A paper's study. `tag`: as on the command line and in the page's marks. `command`: makes the figures, for all
    seeds.
    """

    tag: str
    title: str
    command: str
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
        return Outcome(
            less=Interval.of(less),
            more=Interval.of(more),
            difference=Interval.of(more - less),
            seeds_for=int(np.count_nonzero(less < more)),
            seeds=len(less),
            p=_p(more - less),
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


def _p(differences: NDArray[np.float64]) -> float:
    """Two-sided, of Student's t; 1 for one seed, and for differences that are all 0."""
    if len(differences) < 2 or not differences.any():
        return 1.0
    scatter = differences.std(ddof=1) / np.sqrt(len(differences))
    return float(2.0 * stats.t.sf(abs(differences.mean()) / scatter, len(differences) - 1)) if scatter > 0.0 else 0.0


def holm(probabilities: Sequence[float], level: float = LEVEL) -> float:
    """Below this a probability is decided, so that with `level` at most none of all is decided wrongly.

    Holm 1979: in ascending order, p_1 is compared with level/m, p_2 with level/(m − 1), …, until one is not below.
    """
    for place, p in enumerate(sorted(probabilities)):
        if p >= level / (len(probabilities) - place):
            return p
    return level


def page_of(paper: Paper, results: Results) -> str:
    """All tables of a paper."""
    orderings = [one for section in paper.sections for one in section.statements if isinstance(one, Ordering)]
    asked = [(one, world) for one in orderings for world in ("", *one.worlds)]
    level = holm([results.outcome(one, world).p for one, world in asked])
    seeds = len(results.by_seed)
    head = f"Means of {seeds} simulated robots (seeds) with their 95 % confidence intervals"
    head += f", by `{paper.command}`." if paper.command else "."
    if asked:
        head += f"\n*Yes* and *no* after Holm's correction over the {len(asked)} comparisons of this page."
    return "\n\n".join([head, *(_section(section, results, level) for section in paper.sections)])


def _section(section: Section, results: Results, level: float) -> str:
    figures = [_figure(one, results) for one in section.statements if isinstance(one, Figure)]
    orderings = [_ordering(one, results, level) for one in section.statements if isinstance(one, Ordering)]
    parts = [f"### {section.title}"]
    parts += ["\n".join([FIGURES, *figures])] if figures else []
    parts += ["\n".join([ORDERINGS, *orderings])] if orderings else []
    return "\n\n".join(parts)


def _figure(figure: Figure, results: Results) -> str:
    ours = results.interval(figure.key).text(figure.digits)
    return f"| {figure.text} | {figure.paper or '–'} | {ours} | {figure.note} |"


def _ordering(ordering: Ordering, results: Results, level: float) -> str:
    found, digits = results.outcome(ordering), ordering.digits
    cells = [
        ordering.text,
        ordering.paper,
        found.less.text(digits),
        found.more.text(digits),
        found.difference.text(digits),
        f"{found.holds(level)} ({found.seeds_for} of {found.seeds})",
        _otherwise(ordering, found.holds(level), results, level),
        ordering.note,
    ]
    return "| " + " | ".join(cells) + " |"


def _otherwise(ordering: Ordering, here: Holds, results: Results, level: float) -> str:
    """The switches under which another answer is decided than in the cell's own World."""
    outcomes = {world: results.outcome(ordering, world) for world in ordering.worlds}
    answers = {world: one.holds(level) for world, one in outcomes.items()}
    others = [
        f"{answer}: `{world}` ({outcomes[world].difference.text(ordering.digits)})"
        for world, answer in answers.items()
        if answer not in (here, "not decided")
    ]
    if others:
        return ", ".join(others)
    return f"none of {', '.join(f'`{world}`' for world in outcomes)}" if outcomes else "–"
