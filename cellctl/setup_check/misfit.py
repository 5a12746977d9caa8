"""Distance of nominal, registered, from the rows, and the prediction of tolerances for a robot of its kind."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Self, final

import numpy as np

from cellctl.calibration.model.unknowns import State
from cellctl.calibration.problem.task import Task
from cellctl.calibration.rows.row_blocks import RowBlocks
from cellctl.kinematics import Floats
from cellctl.setup_check.hypothesis import Setup

CORE = 0.6
"""The share of each block's rows, the nearest, that decide: up to 40 % outliers change nothing."""

SAMPLE = 150
"""Rows that judge a hypothesis."""

SCREEN = 60
"""Rows that select the hypotheses to judge."""

ROUNDS = 4
"""Of leaving out the farthest rows, at the most."""

SUSPICIOUS = 3.0
"""Times the predicted RMS: a robot three times worse than its tolerances, or an error that these rows hardly show.
Only errors without an angle to fit (signs, units, columns, order) are then searched."""

IMPLAUSIBLE = 6.0
"""Times the predicted RMS: implausible for a robot of its kind. Robots drawn from the tolerances reach 1.5."""

EXPLAINED = 3.0
"""Times the predicted RMS up to which a hypothesis explains the rows."""

FAR = 8.0
"""A row beyond this multiple of the predicted distance is an outlier."""

LEAST_MM = 2.0
LEAST_DEG = 0.5
"""Smaller errors are not set-up errors, even with tight tolerances."""

FLOOR_MM = 0.3
FLOOR_DEG = 0.03
"""Lower bound of predictions: a prior model may be more precise than a set-up."""


@final
@dataclass(frozen=True, eq=False)
class Misfit:
    """Nominal registered on the rows that are nearest to it. mm, deg: RMS over these (deg: of poses, else 0).

    kept: these rows, by block. predicted_mm, predicted_deg: what tolerances and noise predict for mm and deg.
    """

    state: State
    kept: tuple[Any, ...]
    mm: float
    deg: float
    predicted_mm: float = FLOOR_MM
    predicted_deg: float = FLOOR_DEG

    @property
    def ratio(self) -> float:
        """Misfit as a multiple of the prediction."""
        return max(self.mm / self.predicted_mm, self.deg / self.predicted_deg)

    @property
    def suspicious(self) -> bool:
        """Whether to search for a set-up error."""
        return self.far_mm(SUSPICIOUS) or self.deg > max(SUSPICIOUS * self.predicted_deg, LEAST_DEG)

    @property
    def implausible(self) -> bool:
        """Whether no robot of this kind is so far from its table."""
        return self.far_mm(IMPLAUSIBLE) or self.deg > max(IMPLAUSIBLE * self.predicted_deg, LEAST_DEG)

    def far_mm(self, ratio: float) -> bool:
        """Whether positions alone are further than `ratio` times the prediction."""
        return self.mm > max(ratio * self.predicted_mm, LEAST_MM)

    @property
    def size(self) -> float:
        """One number to compare hypotheses by: 1 mm counts as much as 0.1°."""
        return float(np.hypot(self.mm / 1.0, self.deg / 0.1))

    @property
    def limit_mm(self) -> float:
        """A row that is further from nominal is an outlier, mm."""
        return FAR * max(self.predicted_mm, self.mm)

    def with_prediction(self, setup: Setup) -> Self:
        """With the prediction of the tolerances for the rows of `setup`."""
        mm, deg = _predicted(setup.task, self.state, self.kept)
        return replace(self, predicted_mm=mm, predicted_deg=deg)


def misfit(setup: Setup, rounds: int = ROUNDS) -> Misfit:
    """Nominal registered on all rows, then on those nearest to it, `rounds` times or until they stay the same."""
    task = replace(setup.task, rough=None)
    kept = [np.arange(len(block)) for block in task.rows.blocks]
    for _ in range(rounds):
        state, before = task.start(only(task.rows, kept)), kept
        kept = [nearest(errors[0]) for errors in row_errors(task, state)]
        if all(np.array_equal(now, then) for now, then in zip(kept, before, strict=True)):
            break
    errors = row_errors(task, state)
    mm = np.concatenate([one[0][which] for one, which in zip(errors, kept, strict=True)])
    deg = [one[1][which] for one, which in zip(errors, kept, strict=True) if one[1] is not None]
    return Misfit(state, tuple(kept), rms(mm), rms(np.concatenate([np.zeros(0), *deg])))


def row_errors(task: Task, state: State) -> list[tuple[Floats, Floats | None]]:
    """For each block the rows' distances (N,), mm, and rotations (N,), deg, None where nothing measured them."""
    found = [block.errors_and_turns(state) for block in task.rows.blocks]
    return [(mm, None if turns is None else np.rad2deg(turns)) for mm, turns in found]


def distances(setup: Setup, state: State) -> Floats:
    """The distances (M,) of all rows, mm."""
    return np.concatenate([mm for mm, _ in row_errors(setup.task, state)])


def rms(values: Any) -> float:
    """Root mean square; 0 for no values."""
    array = np.asarray(values, float)
    return float(np.sqrt(np.mean(array**2))) if array.size else 0.0


def steps_of(sizes: Floats) -> Floats:
    """Sizes in steps of factor 1.5, from the least: those within a step are equal."""
    least = max(float(np.min(sizes, initial=np.inf)), 1e-9)
    return np.asarray(np.floor(np.log(np.maximum(sizes, least) / least) / np.log(1.5)))


def only(rows: RowBlocks, kept: Sequence[Any]) -> RowBlocks:
    """The rows at `kept`, indices for each block."""
    return RowBlocks(tuple(block.pick(which) for block, which in zip(rows.blocks, kept, strict=True)))


def nearest(errors: Floats) -> Any:
    """Indices, ascending, of the `CORE` of rows with the smallest `errors` (N,)."""
    return np.sort(np.argsort(errors, kind="stable")[: int(np.ceil(CORE * len(errors)))])


def _predicted(task: Task, state: State, kept: tuple[Any, ...]) -> tuple[float, float]:
    """RMS distance, mm, and rotation, deg, at the rows `kept` of robots drawn from the tolerances, once registered."""
    unknowns = task.unknowns(state)
    known = np.diag(unknowns.sigma**2) if unknowns.prior is None else unknowns.prior
    values, vectors = np.linalg.eigh(known)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    blocks = only(task.rows, kept).blocks
    sigma = np.concatenate([block.sigma.ravel() for block in blocks])
    jacobian = np.concatenate([block.jacobian(state).reshape(-1, state.width) for block in blocks]) / sigma[:, None]
    free = task.registration_parameters(unknowns)
    u, s, _ = np.linalg.svd(jacobian[:, free] * np.sqrt(np.diag(known))[free], full_matrices=False)
    tied = u[:, s > 1e-10 * s.max(initial=0.0)]
    root[free] = 0.0
    if unknowns.prior is None:
        root[unknowns.among(frozenset({"base"}))] = 0.0  # without an instrument's rows it moves everything equally
    spread = jacobian @ root
    left = (spread - tied @ (tied.T @ spread)) * sigma[:, None]
    squares = np.sum(left**2, axis=1) + sigma**2
    turns = np.concatenate([np.tile(~block.of_length, len(block)) for block in blocks])
    poses = max(int(np.count_nonzero(turns)) // 3, 1)
    mm = float(np.sqrt(np.sum(squares[~turns]) / sum(map(len, blocks))))
    return max(mm, FLOOR_MM), max(float(np.rad2deg(np.sqrt(np.sum(squares[turns]) / poses))), FLOOR_DEG)
