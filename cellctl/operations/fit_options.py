"""The options of a fit: reports all their errors at once, and interprets them. Errors name an option as on the command
line (`--holdout`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from numbers import Integral, Real
from pathlib import Path
from typing import final

from cellctl.files import InputError, Problem
from cellctl.formats.measurements import KINDS, OWN, ModelTerms, Spacing


@final
@dataclass(frozen=True)
class Judging:
    """The held-out rows: one of a share, folds, a column of fit and test, or each value of a column in turn."""

    holdout: float | None
    folds: int | None
    column: str | None
    by: str | None
    seed: int

    def problems(self) -> list[Problem]:
        """Errors in these options."""
        found = []
        if sum(given is not None for given in (self.holdout, self.folds, self.column, self.by)) > 1:
            cure = "one of --holdout, --folds, --column and --by"
            found.append(option("holdout", "rows are held out in one way", cure))
        given = {"holdout": (self.holdout, Real), "folds": (self.folds, Integral), "seed": (self.seed, Integral)}
        for name, (value, kind) in given.items():  # from Python, anything can be given
            if value is not None and (not isinstance(value, kind) or isinstance(value, bool)):
                what = "number" if kind is Real else "whole number"
                found.append(option(name, f"{value!r} is no {what}", f"give a {what}"))
        if found:
            return found
        if self.holdout is not None and not 0.0 < self.holdout < 1.0:
            found.append(option("holdout", f"{self.holdout:g} is no share", "a number between 0 and 1"))
        if self.folds is not None and self.folds < 2:
            found.append(option("folds", f"{self.folds} is too few", "2 or more"))
        if self.seed < 0:
            found.append(option("seed", f"{self.seed} is negative", "0 or more"))
        if self.column not in (None, "set"):
            cure = "name the column set, with fit or test in it"
            found.append(option("column", f"'{self.column}' is not known", cure))
        return found


@final
@dataclass(frozen=True)
class Asked:
    """The rest of the options, as given."""

    measure: str | None
    model: str
    artefact: Path | None
    distances: bool
    spacing: Sequence[str]
    own: str
    prior: Path | None
    free: str | None
    prior_of_type: Path | None = None

    def refuse(self, judging: Judging) -> None:
        """Raise InputError with all errors in the options; no option is silently ignored."""
        problems = [*self._measure(), *_problems_of(self.model_problem), *self._own(), *self._prior()]
        problems += [problem for words in self.spacing for problem in _problems_of(lambda w=words: spacing_of(w))]
        problems += judging.problems()
        if problems:
            raise InputError(problems)

    @property
    def own_groups(self) -> frozenset[str]:
        """The parameters that each session has separately."""
        return frozenset() if self.own == "none" else frozenset(self.own.split(","))

    @property
    def free_groups(self) -> tuple[str, ...]:
        """The groups that may change; none named: all groups of the model."""
        return tuple(dict.fromkeys(name.strip() for name in self.free.split(","))) if self.free is not None else ()

    @property
    def spacings(self) -> list[Spacing]:
        """The known distances."""
        return [spacing_of(words) for words in self.spacing]

    def model_problem(self) -> None:
        """Raise InputError if the model has no such name."""
        ModelTerms.parse(self.model)

    def _measure(self) -> list[Problem]:
        if self.measure is None or self.measure in KINDS:
            return []
        return [option("measure", f"'{self.measure}' is not known", ", ".join(KINDS))]

    def _own(self) -> list[Problem]:
        if self.own == "none" or set(self.own.split(",")) <= set(OWN):
            return []
        return [option("own", f"'{self.own}' is not known", "base, tool, base,tool or none")]

    def _prior(self) -> list[Problem]:
        if self.prior is None and self.free is None:
            return []
        if self.prior_of_type:
            given = "--prior" if self.prior else "--free"
            cure = "leave one out: a prior model of this robot knows more than its type"
            return [option("prior-of-type", f"does not go with {given}", cure)]
        if self.model != "auto":
            given = "--prior" if self.prior else "--free"
            return [option("model", f"does not go with {given}", f"leave it out: {given} says what is modelled")]
        return []


def spacing_of(words: str) -> Spacing:
    """A known distance from its words. Raises InputError."""
    return Spacing.parse(words)


def option(name: str, what: str, cure: str) -> Problem:
    """An error in an option."""
    return Problem(f"--{name}", 0, 0, what, cure)


def _problems_of(call: object) -> list[Problem]:
    assert callable(call)
    try:
        call()
    except InputError as error:
        return list(error.problems)
    return []
