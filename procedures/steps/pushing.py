"""Inputs and result of the steps that push a run's table."""

from __future__ import annotations

from cellctl.procedure import StepInputs, StepResult


class PushInputs(StepInputs):
    """The id of the table in the run folder; None without a table to push."""

    table: str | None


class Pushed(StepResult):
    """Whether the run's table is active on the controller."""

    active: bool
