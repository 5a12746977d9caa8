"""Result of the steps that judge a run."""

from __future__ import annotations

from typing import Self

from cellctl.procedure import StepResult
from cellctl.records import VerdictRow


class Judged(StepResult):
    """The verdict of the run, and its sentence for the operator."""

    verdict: str
    sentence: str

    @classmethod
    def of(cls, row: VerdictRow) -> Self:
        """Of the recorded verdict."""
        return cls(verdict=row.verdict, sentence=row.sentence)
