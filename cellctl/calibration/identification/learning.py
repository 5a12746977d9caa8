"""Error maps of a model, learnt from the rows that identified its other terms."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Self, final

import numpy as np

from cellctl.calibration.model.effect import Effect, EffectInputs
from cellctl.calibration.model.learnt_map import LearntMap, Residuals
from cellctl.calibration.model.parameter import MM, Group, Parameter, Phrase
from cellctl.calibration.model.postures import Postures
from cellctl.calibration.model.robot_model import RobotModel
from cellctl.calibration.model.unknowns import State
from cellctl.calibration.rows import Measured
from cellctl.calibration.rows.row_blocks import RowBlocks
from cellctl.calibration.solver.estimate import Estimate
from cellctl.kinematics import Floats, SerialChain

ALONG = 1e-3
"""Rows whose numbers show one direction of the TCP this much less than another do not measure a point."""


@final
@dataclass(frozen=True)
class TcpShift(Effect):
    """A shift of the TCP along the axes of the base, the same at each posture: only to see which rows measure it."""

    group: ClassVar[Group] = "shift of the TCP"
    title: ClassVar[str] = "Shift of the TCP"

    @classmethod
    def of_inputs(cls, setup: EffectInputs) -> Self:
        """For any robot."""
        return cls()

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """x, y, z, mm."""
        phrase = Phrase(self.group, self.group)
        return tuple(Parameter(f"shift_{axis}", MM, self.group, f"shift {axis.upper()}", phrase) for axis in "xyz")

    @property
    def sigma(self) -> Floats:
        """1 mm each (3,)."""
        return np.ones(3)

    def shifts(self, nominal: SerialChain, at: Postures) -> Floats:
        """Ψ (N, 3, 3)."""
        return np.tile(np.eye(3), (len(at), 1, 1))


def with_maps(found: Estimate, rows: RowBlocks) -> Estimate:
    """`found` with each of its model's error maps learnt from `rows`, which it was identified from. Each learns what
    the geometry, the effects and the maps before it leave. Raises ValueError for rows that make no map.
    """
    for place, effect in enumerate(found.state.model.effects):
        if isinstance(effect, LearntMap):
            found = _with_map(found, place, effect.learnt(_residuals(found, rows)))
    return found


def _with_map(found: Estimate, place: int, learnt: LearntMap) -> Estimate:
    """`found` with a map that has its content; it has no amounts, so that all else stays."""
    start = found.unknowns.start
    effects = (*start.model.effects[:place], learnt, *start.model.effects[place + 1 :])
    models: list[RobotModel] = [replace(model, effects=effects) for model in start.models]
    return replace(found, unknowns=replace(found.unknowns, start=replace(start, models=tuple(models))))


def _shifted(state: State, along: Floats) -> State:
    """`state` with the TCP shifted by `along` (3,), mm, along the axes of the base."""
    models = [
        replace(model, effects=(*model.effects, TcpShift())).with_deviations(np.append(model.deviations, along))
        for model in state.models
    ]
    return replace(state, models=tuple(models))


def _residuals(found: Estimate, rows: RowBlocks) -> Residuals:
    """What `found` leaves at those of `rows` in which an instrument measures a point."""
    model = found.state.model
    parts = [_of_block(found.state, block) for block in rows.blocks if len(block) and block.of_instrument]
    at = Postures.joined([at for at, _, _ in parts]) if parts else Postures(np.zeros((0, model.n)))
    errors = np.concatenate([np.zeros((0, 3)), *(errors for _, errors, _ in parts)])
    noise = np.concatenate([np.zeros((0, 3)), *(variance for _, _, variance in parts)])
    columns = np.swapaxes(model.chain.base_now[:3, :3].T @ model.jacobian(at)[:, :3], 1, 2)
    covariance = found.covariance[: found.unknowns.robot, : found.unknowns.robot]
    return Residuals(
        model, at, errors, noise + np.einsum("npa,pq,nqa->na", columns, covariance, columns, optimize=True)
    )


def _of_block(state: State, block: Measured) -> tuple[Postures, Floats, Floats]:
    """Postures, errors (N, 3), mm, and their variance by the instrument (N, 3), mm².

    A shift d of the TCP changes the numbers r of a row, model − measurement in σ, by C d. The shift that leaves the
    least of them, −C⁺ r, is actual − model; its covariance is (CᵀC)⁻¹.
    """
    residual = block.residual(state) / block.sigma
    moved = [block.residual(_shifted(state, along)) / block.sigma - residual for along in np.eye(3)]
    columns = np.stack(moved, axis=-1)
    singular = np.linalg.svd(columns, compute_uv=False)
    whole = np.flatnonzero(singular[:, -1] > ALONG * singular[:, 0]) if columns.shape[1] >= 3 else np.zeros(0, int)
    inverse = np.linalg.pinv(columns[whole])
    errors = -np.einsum("nak,nk->na", inverse, residual[whole])
    return block.postures.pick(whole), errors, np.sum(inverse**2, axis=2)
