"""What a model of linearised rows leaves of the TCP's errors: from this a residual model chooses its settings."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Self, final

import numpy as np

from cellctl.calibration.effects import Effect, EffectInputs
from cellctl.calibration.estimation.identify import nominal_start
from cellctl.calibration.estimation.linear import Linear
from cellctl.calibration.estimation.task import Task
from cellctl.calibration.model.parameter import MM, Group, Parameter, Phrase
from cellctl.calibration.model.postures import Postures
from cellctl.calibration.residuals.residual_model import Remainder
from cellctl.calibration.rows.row_blocks import RowBlocks
from cellctl.kinematics import Floats, SerialChain

ROWS = 300
"""Rows used, at most: the time grows with their cube, and the settings hardly change."""

ALONG = 1e-3
"""Rows whose numbers show one direction of the TCP this much less than another do not measure a point."""


@final
@dataclass(frozen=True)
class _TcpShift(Effect):
    """A shift of the TCP along the axes of the base, the same at each posture: only to see which rows measure it."""

    group: ClassVar[Group] = "shift of the TCP"
    title: ClassVar[str] = "Shift of the TCP"

    @classmethod
    def of_inputs(cls, setup: EffectInputs) -> Self:
        return cls()

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        phrase = Phrase(self.group, self.group)
        return tuple(Parameter(f"shift_{axis}", MM, self.group, f"shift {axis.upper()}", phrase) for axis in "xyz")

    @property
    def sigma(self) -> Floats:
        return np.ones(3)

    def shifts(self, nominal: SerialChain, at: Postures) -> Floats:
        return np.tile(np.eye(3), (len(at), 1, 1))


def shifts_of_tcp(task: Task, rows: RowBlocks) -> Floats:
    """How a shift of the TCP by 1 mm along each axis of the base changes the numbers of each row: (N, k, 3), in σ."""
    moved = task.with_effects((_TcpShift(),))
    unknowns = nominal_start(moved, rows)
    only = unknowns.masked(unknowns.among(frozenset({_TcpShift.group})))
    return Linear.about(only, np.zeros(len(only.names)), rows, ()).columns


def remainder(rows: RowBlocks, linear: Linear, at: Any, prior: tuple[Floats, Floats], shifts: Floats) -> Remainder:
    """Of N rows, for the model of the unknowns `at` (indices into those of `linear`).

    prior: inverse covariance (F, F) of these unknowns without the rows, and gradient (F,). shifts: see `shifts_of_tcp`.
    Rows in which no instrument measures a point (touches, sockets) are left out: the places of their own points take up
    a part of each smooth error.
    """
    singular = np.linalg.svd(shifts, compute_uv=False)
    whole = rows.of_instrument & (singular[:, -1] > ALONG * singular[:, 0])
    points = np.flatnonzero(whole) if shifts.shape[1] >= 3 else np.zeros(0, int)
    points = np.sort(np.random.default_rng(len(points)).permutation(points)[:ROWS])
    to_mm = np.linalg.pinv(shifts[points])
    columns = to_mm @ linear.columns[points][..., at]
    covariance = np.linalg.inv(prior[0])
    away = linear.away[points] - linear.columns[points][..., at] @ (covariance @ prior[1])
    errors = -np.einsum("nak,nk->na", to_mm, away)
    return Remainder(rows.q[points], errors, np.einsum("naf,fg,mag->anm", columns, covariance, columns, optimize=True))
