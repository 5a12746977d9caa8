"""Inputs of campaigns that measure in batches until a goal: of the plan before them, and of the step after each."""

from __future__ import annotations

from typing import Annotated, ClassVar, Self

from pydantic import Field, model_validator

from cellctl.procedure import StepInputs


class BatchPlanInputs(StepInputs):
    """fit, held_out: rows to identify from, and all that judge.

    With a goal (`goal_mm` > 0) there are `first` rows of the fit and half of the held-out ones, then batches of `batch`
    rows of the fit, up to `most` in all; `fit` does not count, and the rows of the fit are the best ones. NOUN: what
    the rows are.
    """

    NOUN: ClassVar[str] = "rows"
    fit: Annotated[int, Field(ge=5)]
    held_out: Annotated[int, Field(ge=0)]
    goal_mm: Annotated[float, Field(ge=0)] = 0.0
    first: Annotated[int, Field(ge=5)] = 35
    batch: Annotated[int, Field(ge=1)] = 10
    most: Annotated[int, Field(ge=5)] = 150

    @property
    def at_first(self) -> int:
        """Rows of the fit that are planned before any is made."""
        return self.first if self.goal_mm else self.fit

    @property
    def held_out_at_first(self) -> int:
        """Held-out rows among them; with a goal the others come after the last batch."""
        return self.held_out - self.held_out // 2 if self.goal_mm else self.held_out

    @property
    def batches(self) -> int:
        """Batches at most, and one pass more: the end is stated after the last batch."""
        return 1 + -(-(self.most - self.first) // self.batch) if self.goal_mm else 0

    @model_validator(mode="after")
    def _most_after_first(self) -> Self:
        if self.goal_mm and self.most < self.first:
            raise ValueError(f"{self.most} {self.NOUN} at most are fewer than the first {self.first}: allow more")
        return self


class BatchInputs(StepInputs):
    """batch: its number. goal_mm, most (rows of the fit), minutes (0: any), gain_percent: what ends the campaign.
    size: rows of a batch. held_out: of the campaign; a half of them follows the last batch.
    """

    batch: Annotated[int, Field(ge=0)]
    goal_mm: Annotated[float, Field(ge=0)]
    size: Annotated[int, Field(ge=1)]
    most: Annotated[int, Field(ge=5)]
    minutes: Annotated[float, Field(ge=0)] = 0.0
    gain_percent: Annotated[float, Field(ge=0, lt=100)] = 2.0
    held_out: Annotated[int, Field(ge=0)] = 0

    @property
    def held_out_at_last(self) -> int:
        """Held-out rows that follow the last batch."""
        return self.held_out // 2
