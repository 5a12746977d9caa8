"""The local optimum of a new tool: tools that explain the rows are compared by their probability.

Each tool is weighed by the probability of the rows, integrated over the prior of all other parameters:
−2 ln p = r S⁻¹ r + ln det S with S = I + J P Jᵀ. An uncertain robot lowers the penalty of a tool's residuals.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cellctl.calibration.estimation.estimate import Estimate, linearised
from cellctl.calibration.estimation.tool_search import Touched, tool_of
from cellctl.calibration.model.unknowns import State, Unknowns
from cellctl.calibration.rows import Rows
from cellctl.calibration.rows.row_blocks import RowBlocks
from cellctl.kinematics import Floats

IMPROBABLE = 0.01
"""A tool whose probability relative to the best is below this is rejected."""

ALIKE = 0.5
"""Two tools with odds of at least this count as equally probable."""

BEYOND = 16.3
"""A tool within this squared distance, in σ, of the one found is the same: 99.9 % of χ² with three degrees."""


def tools(unknowns: Unknowns, rows: RowBlocks, certain: Sequence[Rows]) -> list[State]:
    """Hypotheses for tool and points: the start of `unknowns` with each tool from a local optimum of its touches, the
    most probable first; unchanged where there are no touches.
    """
    touched = Touched.of(unknowns.start, rows, certain)
    if not len(touched.reach):
        return [unknowns.start]
    blocks = [*rows.blocks, *certain]
    return sorted(touched.local_optima(), key=lambda state: improbability(unknowns, state, blocks))


def undecided(found: Estimate, rows: RowBlocks, certain: Sequence[Rows], others: Sequence[State]) -> Estimate:
    """`found`; reported as not converged, with σ enlarged to cover them, where the rows make one of the tools `others`
    almost as probable, or are too few to find any.
    """
    blocks = [*rows.blocks, *certain]
    best, rivals = improbability(found.unknowns, found.state, blocks), []
    for other in others:
        moved = _move(found.state, other)
        odds = float(np.exp(0.5 * min(best - improbability(found.unknowns, other, blocks), 0.0)))
        if odds > IMPROBABLE and _is_another(found, moved):
            rivals.append((odds, moved))
    touched = Touched.of(found.state, rows, certain)
    if not rivals and not touched.lacking:
        return found
    wider = found.covariance + _spread(rivals, found.covariance.shape)
    return replace(found, covariance=wider, converged=False, ended=_too_few(touched) or _open(found, rivals))


def improbability(unknowns: Unknowns, state: State, blocks: Sequence[Rows]) -> float:
    """−2 ln of the probability of `blocks` about `state`, up to a constant; integrated over the uncertainty in
    `unknowns.prior`.
    """
    assert unknowns.prior is not None
    size = np.sqrt(np.diag(unknowns.prior))
    scale = np.where(size > 0.0, size, 1.0)
    values, vectors = np.linalg.eigh(unknowns.prior / np.outer(scale, scale))
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    square, pull, rest = np.eye(len(root)), np.zeros(len(root)), 0.0
    for block in blocks:
        lines, away = linearised(block, state, np.arange(len(root)), scale)
        columns, residual = lines.reshape(-1, len(root)) @ root, away.reshape(-1)
        square, pull = square + columns.T @ columns, pull + columns.T @ residual
        rest += float(residual @ residual)
    return rest - float(pull @ np.linalg.solve(square, pull)) + float(np.linalg.slogdet(square)[1])


def _move(here: State, there: State) -> Floats:
    """Difference of all parameters (P,)."""
    result = np.zeros(here.width)
    for columns, one, other in zip(here.columns, here.models, there.models, strict=True):
        result[columns] = other.deviations - one.deviations
    result[here.of_points] = (there.points - here.points).ravel()
    return result


def _is_another(found: Estimate, moved: Floats) -> bool:
    """Whether the tool `moved` to (P,) lies outside the σ of the one found."""
    tool = tool_of(found.state)
    return bool(moved[tool] @ np.linalg.solve(found.covariance[np.ix_(tool, tool)], moved[tool]) > BEYOND)


def _spread(rivals: Sequence[tuple[float, Floats]], shape: tuple[int, ...]) -> Floats:
    """Variance (P, P) from the open choice of tool, with the odds and distances (P,) of the rivals."""
    total = 1.0 + sum(odds for odds, _ in rivals)
    return np.asarray(sum((odds / total * np.outer(moved, moved) for odds, moved in rivals), np.zeros(shape)))


def _too_few(touched: Touched) -> str:
    """Message that distances are too few to find tool and points; empty where they are enough."""
    if not touched.lacking:
        return ""
    numbers = len(touched.reach) + len(touched.mm)
    what = f"{numbers} distances do not find, and check, {touched.unknown} numbers of tool and points"
    return f"{what}: {touched.lacking} more at least, or fewer points"


def _open(found: Estimate, rivals: Sequence[tuple[float, Floats]]) -> str:
    """Message that another tool is as good."""
    odds, moved = max(rivals, key=lambda rival: rival[0])
    away = float(np.linalg.norm(moved[tool_of(found.state)]))
    as_good = "as probable" if odds > ALIKE else f"{odds:.2g} times as probable"
    return (
        f"the rows leave open which tool it is: one {away:.1f} mm from that found is {as_good}; touch from more sides"
    )
