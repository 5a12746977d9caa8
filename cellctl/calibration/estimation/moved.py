"""Whether robot, instrument or tool have been set up anew since a prior model was made."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np

from cellctl.calibration.estimation.task import Task
from cellctl.calibration.model.unknowns import State
from cellctl.calibration.rows.row_blocks import RowBlocks

MOVED = 4.0
"""A prior model whose errors fall by this factor when it is registered has been set up anew: drift does less."""


@final
@dataclass(frozen=True, slots=True)
class Placing:
    """RMS distance of a prior model, 3-D, mm, from what an instrument measured: as it is, and registered anew."""

    as_is_mm: float
    registered_mm: float

    @property
    def moved(self) -> bool:
        """Whether base or tool have moved since the prior model."""
        return self.as_is_mm >= MOVED * self.registered_mm and self.as_is_mm > 0.0


def placing(task: Task, registered: State, rows: RowBlocks) -> Placing | None:
    """How far `task.model` is from the positions and poses of the first session in `rows`; None without such rows.

    Further sessions may have their own base and tool, which are not in a prior model.
    """
    measured = [block for block in rows.blocks if block.of_instrument and block.session == 0 and len(block)]
    if task.prior is None or not measured:
        return None
    seen = RowBlocks.of(tuple(measured))
    as_is, anew = (seen.errors(state) for state in (State.alone(task.model), registered))
    return Placing(float(np.sqrt(np.mean(as_is**2))), float(np.sqrt(np.mean(anew**2))))
