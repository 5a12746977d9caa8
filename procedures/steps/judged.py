"""Inputs and results of the steps that judge a run or push its table."""

from __future__ import annotations

from typing import Self

from cellctl.procedure import StepInputs, StepResult
from cellctl.records import VerdictRow


class Judged(StepResult):
    """The verdict of the run, and its sentence for the operator."""

    verdict: str
    sentence: str

    @classmethod
    def of(cls, row: VerdictRow) -> Self:
        """Of the recorded verdict."""
        return cls(verdict=row.verdict, sentence=row.sentence)


class PushInputs(StepInputs):
    """The id of the table in the run folder; None without a table to push."""

    table: str | None


class Pushed(StepResult):
    """Whether the run's table is active on the controller."""

    active: bool
