"""The row of a verdict: the fields common to all kinds of campaign."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, final

from cellctl.records.row import Json, Row
from cellctl.records.table import TableStateRow


@final
@dataclass(frozen=True)
class Figures:
    """Mean, root mean square and maximum of a set of errors, mm; None without errors."""

    mean: float | None
    rms: float | None
    max: float | None


PASSED = frozenset({"better", "in control", "baseline", "measured"})
"""Verdicts with which a run ends well. The last three are of a check of a robot, which compares with no model."""


@dataclass(frozen=True)
class VerdictRow(Row):
    """The result of a campaign. Each kind of campaign derives its own row with the fields of its result's section.

    SECTION: the names of these fields, in the order in which the result shows them. verdict: `better`, `no better` or
    `worse`, or a check's own word. sentence: for the operator; lines: shown below it. before, after: measured errors.
    model: the report of the fit, as `cellctl fit --json` prints it.
    """

    KIND: ClassVar[str] = "verdict"
    SECTION: ClassVar[tuple[str, ...]] = ()
    verdict: str
    sentence: str
    before: Figures | None = None
    after: Figures | None = None
    model: Mapping[str, Json] | None = None
    table: TableStateRow | None = None
    lines: tuple[str, ...] = ()

    @property
    def better(self) -> bool:
        """Whether the verdict is `better`."""
        return self.verdict == "better"

    @property
    def passed(self) -> bool:
        """Whether the run ends with exit code 0."""
        return self.verdict in PASSED
