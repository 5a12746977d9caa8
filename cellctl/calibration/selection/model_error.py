"""Whether rows show that a model is incomplete: then a residual model is added, by the evidence of the rows."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from cellctl.calibration.effects import EffectInputs, ResidualModel, in_order, kinds
from cellctl.calibration.estimation.estimate import Estimate
from cellctl.calibration.estimation.evidence import Factor, System
from cellctl.calibration.estimation.task import Task
from cellctl.calibration.model.parameter import Group
from cellctl.calibration.model.postures import Postures
from cellctl.calibration.model.unknowns import Unknowns
from cellctl.calibration.rows import Rows
from cellctl.calibration.rows.row_blocks import RowBlocks
from cellctl.kinematics import Floats

ROWS_AT_LEAST = 10

SHOWN = 2.0
"""A residual model has to raise the logarithm of the evidence by this: seven times as probable. A spurious one only
makes σ larger; if a necessary one is missing, σ is too small.
"""


def without_functions(task: Task) -> Task:
    """`task` without residual models; unchanged where they belong to a prior model."""
    if task.prior is not None:
        return task
    return task.with_effects(tuple(effect for effect in task.model.effects if not isinstance(effect, ResidualModel)))


def may_join(task: Task) -> list[type[ResidualModel]]:
    """Residual models that may be added: only if the robot's geometry is identified, without a prior model."""
    if task.prior is not None or task.groups is not None:
        return []
    there = {effect.group for effect in task.model.effects}
    of_evidence = [kind for kind in kinds().values() if kind.chosen == "by evidence" and kind.group not in there]
    return [kind for kind in of_evidence if issubclass(kind, ResidualModel)]


def with_kind(task: Task, kind: type[ResidualModel], rows: RowBlocks) -> Task | None:
    """`task` with a residual model of this kind added, made from `rows`; None where they cannot determine it."""
    made = kind.of_inputs(EffectInputs(task.model.chain, Postures(rows.q)))
    return None if made is None else task.with_effects(in_order([*task.model.effects, made]))


def scales_with(
    group: Group, found: Estimate, wider: Unknowns, rows: RowBlocks, certain: list[Rows], scales: dict[Factor, float]
) -> dict[Factor, float] | None:
    """Noise and prior scales with the residual model `group` that `wider` adds to what was `found` with `scales`; None
    where the rows are hardly more probable with it.
    """
    system = System.of(wider, carried(found, wider), rows, certain)
    logs = {factor: float(np.log(value)) for factor, value in scales.items()}
    gain, tuned = system.gain((group, 0), logs)
    if gain < SHOWN:
        return None
    return {factor: float(np.exp(value)) for factor, value in tuned.items()}


def carried(found: Estimate, wider: Unknowns) -> Floats:
    """The deviations (P,) of `found` for unknowns with additional amounts, which are 0."""
    deviations = np.zeros(len(wider.names))
    deviations[_places(found.unknowns, wider)] = found.deviations
    return deviations


def widened(found: Estimate, wider: Unknowns) -> Estimate:
    """`found` for unknowns with additional amounts, held at 0."""
    places, given = _places(found.unknowns, wider), found.unknowns
    free = np.zeros(len(wider.names), bool)
    free[places] = given.free
    covariance = np.zeros((len(free),) * 2)
    covariance[np.ix_(places, places)] = found.covariance
    pinned = None
    if given.pinned is not None:
        pinned = np.zeros((len(given.pinned), len(free)))
        pinned[:, places] = given.pinned
    unknowns = replace(wider, free=free, pinned=pinned)
    return replace(found, unknowns=unknowns, deviations=carried(found, wider), covariance=covariance)


def _places(unknowns: Unknowns, wider: Unknowns) -> Any:
    place = {name: number for number, name in enumerate(wider.names)}
    return [place[name] for name in unknowns.names]
