"""Joints of a model for targets, and why a target gets no row in the table."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, Self, final

import numpy as np

from cellctl.compensation import Compensated
from cellctl.devices.cell import online_correction_deg, table_correction_deg
from cellctl.formats import ModelFile
from cellctl.formats.table import row_problems
from cellctl.formats.table_making import compensated_targets, nominal_chain, target_rows, valid_region
from cellctl.kinematics import Bools, Floats
from cellctl.procedure import CellContext


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


class MannerWanted(Protocol):
    """The part of a step's settings that says how targets are compensated."""

    @property
    def method(self) -> str:
        """Method of compensation."""

    @property
    def passes(self) -> int:
        """Passes of the method, 0: until it converges."""

    @property
    def online(self) -> bool:
        """Whether the robot goes to the nominal joints and is corrected on-line."""


_OF_ONLINE_LIMIT = 0.9
"""Share of the on-line limit that a target may need: a correction keeps room for braking before it."""


def manner_of(context: CellContext, wanted: MannerWanted) -> Manner:
    """How a step compensates in this cell."""
    limit = table_correction_deg(context.cell)
    if wanted.online:
        limit = min(limit, _OF_ONLINE_LIMIT * online_correction_deg(context.cell))
    return Manner(wanted.method, wanted.passes or None, limit)


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
