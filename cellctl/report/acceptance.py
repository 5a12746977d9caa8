"""The decision on an acceptance limit, by a stated rule."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Self, final

from cellctl.report.budget import Budget
from cellctl.report.run import Run

RULE: Final = (
    "ISO 14253-1, with the expanded uncertainty U (95 %) of a measured error as guard band: accepted if the greatest "
    "error plus U is within the limit; rejected if the greatest error less U is beyond it; otherwise neither is proved."
)


NO_DECISION: Final = "no decision"


@final
@dataclass(frozen=True, slots=True)
class Decision:
    """word: `accepted`, `rejected` or `no decision`; reason: in a sentence. greatest_mm: the greatest error, if any."""

    word: str
    reason: str
    greatest_mm: float | None = None

    @property
    def decided(self) -> bool:
        """Whether it is accepted or rejected."""
        return self.word != NO_DECISION

    @classmethod
    def of(cls, run: Run, limit_mm: float | None, budget: Budget | None) -> Self:
        """By RULE."""
        verdict = run.verdict
        greatest = verdict.after.max if verdict and verdict.after and run.word == "finished" else None
        if limit_mm is None:
            return cls(NO_DECISION, "No acceptance limit is stated.", greatest)
        if greatest is None:
            return cls(NO_DECISION, "The run has no measured error after calibration.")
        if budget is None:
            return cls(
                NO_DECISION, "The run identified no model: the uncertainty of its errors is not known.", greatest
            )
        return cls(*_compared(greatest, budget.expanded_mm[0], limit_mm), greatest)


def _compared(greatest_mm: float, expanded_mm: float, limit_mm: float) -> tuple[str, str]:
    if greatest_mm + expanded_mm <= limit_mm:
        return "accepted", "The greatest error plus U is within the limit."
    if greatest_mm - expanded_mm > limit_mm:
        return "rejected", "The greatest error less U is beyond the limit."
    return NO_DECISION, "The greatest error is nearer to the limit than U: neither is proved."
