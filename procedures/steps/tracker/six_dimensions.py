"""Figures of an identification from poses: errors by axis and angle, and |R_ii| of the QR."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from cellctl.calibration import FitResult, PoseRows, Split, State
from cellctl.calibration.observability.unobservable import SEEN
from cellctl.formats import Measurements
from procedures.steps.tracker.rows import SixFigures, SixRow

Indices: TypeAlias = NDArray[np.intp]


def six_row(measured: Measurements, result: FitResult, split: Split) -> SixRow:
    """The row of a fit from poses."""
    held_out = np.array([of == "test" for of in measured.sets])
    left_out = np.zeros(len(held_out), bool)
    left_out[list(result.identification.outliers)] = True
    names, r = pivots(result)
    return SixRow(
        fit=_figures(measured, result, np.flatnonzero(~held_out & ~left_out)),
        test=_figures(measured, result, np.flatnonzero(held_out)),
        parameters=names,
        r=r,
        observable=SEEN,
    )


def pivots(result: FitResult) -> tuple[tuple[str, ...], tuple[float, ...]]:
    """Names and |R_ii| of the free parameters by column-pivoted QR of the Jacobian, in σ of the rows per prior σ."""
    found = result.identification.identified
    free = np.flatnonzero(found.unknowns.free)
    _, triangle, order = scipy.linalg.qr(found.triangle, mode="economic", pivoting=True)
    names = tuple(found.unknowns.parameters[free[at]].name for at in order)
    return names, tuple(np.abs(np.diag(triangle)).tolist())


def _figures(measured: Measurements, result: FitResult, which: Indices) -> SixFigures:
    states = result.identification.nominal.state, result.identification.identified.state
    (before, angle_before), (after, angle_after) = (_means(measured, state, which) for state in states)
    return SixFigures(n=len(which), before=before, after=after, angle_before=angle_before, angle_after=angle_after)


def _means(measured: Measurements, state: State, which: Indices) -> tuple[tuple[float, ...], float]:
    blocks = [block for block in measured.task.rows.pick(which).blocks if isinstance(block, PoseRows) and len(block)]
    if not blocks:
        return (0.0, 0.0, 0.0), 0.0
    six = np.concatenate([block.deviation(state) for block in blocks])
    angle = np.degrees(np.linalg.norm(six[:, 3:], axis=1)).mean()
    return tuple(np.abs(six[:, :3]).mean(axis=0).tolist()), float(angle)
