"""Joints of a model for targets, and why a target gets no row in the table."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self, final

import numpy as np

from cellctl.compensation import Compensated
from cellctl.formats import ModelFile
from cellctl.formats.table_making import compensated_targets, nominal_chain, target_rows, valid_region
from cellctl.formats.table_refusals import row_problems
from cellctl.kinematics import Bools, Floats


@final
@dataclass(frozen=True, slots=True)
class Manner:
    """How targets are compensated: method, the most passes (None: until it converges), the cell's limit, deg."""

    method: str
    passes: int | None
    limit_deg: float

    @property
    def name(self) -> str:
        """As a table file names it."""
        made = "" if self.passes is None else f", {self.passes} pass{'' if self.passes == 1 else 'es'}"
        return f"{self.method}{made}"


@final
@dataclass(frozen=True, eq=False)
class Compensable:
    """N targets (N, 4, 4), mm, in the model's frame, their nominal readings (N, n), deg, and the joints found.

    reasons: why each gets no row, empty where it gets one.
    """

    targets: Floats
    readings: Floats
    found: Compensated
    reasons: tuple[str, ...]

    @classmethod
    def of(cls, model: ModelFile, readings: Floats, manner: Manner) -> Self:
        """Of the targets where the registered nominal robot would be at `readings` (N, n), deg."""
        targets = nominal_chain(model).forward(model.robot.joint_map().model(readings))
        found = compensated_targets(model, targets, readings, method=manner.method, passes=manner.passes)
        rows = target_rows(model, targets, found)
        refused = row_problems(rows, valid_region(model), model.robot, manner.limit_deg)
        pairs = zip(found.reasons, refused, strict=True)
        reasons = tuple(reason or next(iter(of_row), "") for reason, of_row in pairs)
        return cls(targets, readings, found, reasons)

    @property
    def good(self) -> Bools:
        """Which targets (N,) get a row."""
        return np.array([not reason for reason in self.reasons], bool)
