"""Whether rows show that a model lacks something: then a discrepancy term joins it, by the evidence of the rows."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from cellctl.calibration.effects import Discrepancy, ResidualModel, in_order
from cellctl.calibration.estimation.estimate import Estimate
from cellctl.calibration.estimation.evidence import Factor, System
from cellctl.calibration.estimation.task import Task
from cellctl.calibration.model.unknowns import Unknowns
from cellctl.calibration.rows import Rows
from cellctl.calibration.rows.row_blocks import RowBlocks
from cellctl.kinematics import Floats

ROWS_AT_LEAST = 10

SHOWN = 2.0
"""A discrepancy has to raise the logarithm of the evidence by this: seven times as probable. One that is there by
chance only makes σ larger; without one that is needed σ is too small.
"""


def without_functions(task: Task) -> Task:
    """`task` without harmonics and discrepancy; as it is where they belong to a prior model."""
    if task.prior is not None:
        return task
    return task.with_effects(tuple(effect for effect in task.model.effects if not isinstance(effect, ResidualModel)))


def may_lack(task: Task) -> bool:
    """Whether a discrepancy is looked for: of a robot whose geometry is identified, and of which nothing was known."""
    there = any(isinstance(effect, Discrepancy) for effect in task.model.effects)
    return task.prior is None and task.groups is None and not there


def with_discrepancy(task: Task, rows: RowBlocks) -> Task:
    """`task` whose model has a discrepancy over the postures of `rows`."""
    return task.with_effects(in_order([*task.model.effects, Discrepancy.over(rows.q)]))


def discrepancy_scales(
    found: Estimate, wider: Unknowns, rows: RowBlocks, certain: list[Rows], scales: dict[Factor, float]
) -> dict[Factor, float] | None:
    """Noise and prior scales with the discrepancy that `wider` has beside what was `found` with `scales`; None where
    the rows are hardly more probable with it.
    """
    system = System.of(wider, carried(found, wider), rows, certain)
    logs = {factor: float(np.log(value)) for factor, value in scales.items()}
    gain, tuned = system.gain((Discrepancy.group, 0), logs)
    if gain < SHOWN:
        return None
    return {factor: float(np.exp(value)) for factor, value in tuned.items()}


def carried(found: Estimate, wider: Unknowns) -> Floats:
    """The deviations (P,) of `found` for unknowns that have amounts besides, which are 0."""
    deviations = np.zeros(len(wider.names))
    deviations[_places(found.unknowns, wider)] = found.deviations
    return deviations


def widened(found: Estimate, wider: Unknowns) -> Estimate:
    """`found` with unknowns that have amounts besides, held at 0."""
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
