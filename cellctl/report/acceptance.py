"""The decision on the limit of a run's measured errors, by ISO 14253-1, from its rows and its uncertainty budget."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Final, final

import numpy as np

from cellctl.metrology.acceptance import COVERAGE, Measurand, MeasuredFigure, Word, decision, measured_figure
from cellctl.records import Figures, Json
from cellctl.report._run import Run
from cellctl.report.budget import Budget

RULE: Final = (
    "ISO 14253-1, with a multiple (1 if not stated) of the expanded uncertainty U (95 %) of the figure as guard band: "
    "accepted if the figure plus the guard band is within the limit; rejected if the figure less the guard band is "
    "beyond it; otherwise neither is proved."
)

NO_DECISION: Final[Word] = "no decision"

NAMES: Final[dict[Measurand, str]] = {
    "mean": "mean error",
    "quantile_95": "95 % quantile of errors",
    "maximum": "greatest error",
}

CONTAINED: Final[dict[Measurand, str]] = {
    "mean": "the sample of places with the scatter of the measurement, and what all errors share",
    "quantile_95": "the sample of places with the scatter of the measurement, and what all errors share",
    "maximum": "the measurement of a single error: its scatter, and what all errors share; no other places",
}
"""What U contains."""

NOT_CONTAINED: Final = "other loads, temperatures and days, and joints outside the measured region"


@final
@dataclass(frozen=True, slots=True)
class Acceptance:
    """The decision, its reason in a sentence, and what it is from. value_mm: of the measurand, also where U is unknown.

    guard: the guard band in units of U. missing: contributions that are not stated, so not in U.
    """

    word: Word
    reason: str
    measurand: Measurand = "maximum"
    limit_mm: float | None = None
    guard: float = 1.0
    value_mm: float | None = None
    figure: MeasuredFigure | None = None
    missing: tuple[str, ...] = ()

    @property
    def decided(self) -> bool:
        """Whether it is accepted or rejected."""
        return self.word != NO_DECISION

    def to_json(self) -> dict[str, Json]:
        """For the lists of runs and other programs; U_mm, k, n: None where U is unknown."""
        figure = self.figure
        return {
            "decision": self.word,
            "reason": self.reason,
            "measurand": self.measurand,
            "limit_mm": self.limit_mm,
            "value_mm": self.value_mm,
            "U_mm": figure.expanded_mm if figure else None,
            "k": figure.factor if figure else None,
            "coverage": COVERAGE,
            "guard_band_mm": self.guard_band_mm if figure else None,
            "n": figure.n if figure else None,
            "not_in_U": list(self.missing),
        }

    @property
    def guard_band_mm(self) -> float:
        """The guard band; 0 where U is unknown."""
        return self.guard * self.figure.expanded_mm if self.figure else 0.0


def acceptance(run: Run, budget: Budget | None, errors: Iterable[Sequence[float]]) -> Acceptance:
    """By RULE. errors: sets of measured errors, mm; the one whose figures the verdict states is that of the run."""
    stated = run.criterion
    found = Acceptance(NO_DECISION, "No acceptance limit is stated.")
    if stated:
        found = replace(found, measurand=stated.measurand, limit_mm=stated.limit_mm, guard=stated.guard)
    after = run.verdict.after if run.verdict and run.word == "finished" else None
    if after is None or after.max is None:
        return _undecided(found, "The run has no measured error after calibration.")
    found = replace(found, value_mm={"mean": after.mean, "maximum": after.max}.get(found.measurand))
    if budget is None:
        return _undecided(found, "The run identified no model: the uncertainty of its errors is not known.")
    own = _own(errors, after)
    if own is None and found.measurand != "maximum":
        return _undecided(found, f"The run recorded no single errors: its {NAMES[found.measurand]} has no uncertainty.")
    try:
        figure = measured_figure(
            found.measurand,
            [after.max] if own is None else own,
            shared_mm=budget.shared_mm,
            single_mm=budget.error_mm,
            single_factor=budget.factors[0],
        )
    except ValueError as error:
        return _undecided(found, f"The {NAMES[found.measurand]} has no uncertainty: {error}.")
    found = replace(found, value_mm=figure.value_mm, figure=figure, missing=tuple(budget.missing))
    return found if found.limit_mm is None else _decided(found, figure.value_mm, found.limit_mm)


def _undecided(found: Acceptance, reason: str) -> Acceptance:
    return found if found.limit_mm is None else replace(found, reason=reason)


def _decided(found: Acceptance, value_mm: float, limit_mm: float) -> Acceptance:
    name, band = NAMES[found.measurand], "U" if found.guard == 1.0 else f"{found.guard:g} U"
    reasons: dict[Word, str] = {
        "accepted": f"The {name} plus {band} is within the limit.",
        "rejected": f"The {name} less {band} is beyond the limit.",
        "no decision": f"The {name} is nearer to the limit than {band}: neither is proved.",
    }
    word = decision(value_mm, found.guard_band_mm, limit_mm)
    return replace(found, word=word, reason=reasons[word])


def _own(errors: Iterable[Sequence[float]], after: Figures) -> Sequence[float] | None:
    """The set of errors with the mean and the maximum of the verdict."""
    figures = [after.mean or 0.0, after.max or 0.0]
    sets = (each for each in errors if len(each))
    return next((each for each in sets if np.allclose([np.mean(each), np.max(each)], figures, rtol=1e-6)), None)
