"""Errors of the registered robot at the rows of a data set: what `cellctl analyse` looks at."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, final

from cellctl.files import InputError, Problem
from cellctl.formats.dataset import DataSet, Rejected
from cellctl.formats.measurements import Measurements, measurements, refuse_alike
from cellctl.formats.model import ModelFile
from cellctl.formats.prior import from_prior
from cellctl.formats.robot import RobotFile

if TYPE_CHECKING:
    from cellctl.analysis import ErrorSet
    from cellctl.calibration import State
    from cellctl.calibration.rows.row_blocks import RowBlocks
    from cellctl.kinematics import Bools, Floats

FAR = 6.0
"""Distance from the middle of all errors, in medians of that distance: 9 σ of errors that are normal in 3-D."""


@final
@dataclass(frozen=True, eq=False)
class RobotErrors:
    """The errors, and what was left out. total: usable rows; sampled: rows looked at; outliers: lines left out;
    apart: outliers where these were too many to leave out.
    """

    found: ErrorSet
    total: int
    sampled: int
    outliers: tuple[int, ...]
    apart: int
    rejected: tuple[Rejected, ...]


def rows_with_positions(robot: RobotFile, data: DataSet) -> Measurements:
    """The rows with a measured position. Raises InputError where there are too few, or all are at one place."""
    measured = measurements(robot, data, measure="position", model="geometry")
    refuse_alike(measured)
    return measured


def robot_errors(
    measured: Measurements, model: ModelFile | None = None, file: str = "", most: int = 300, seed: int = 0
) -> RobotErrors:
    """Measured less nominal position at the rows, base and tool registered, in the robot's base frame.

    model: identified robot in place of nominal; file: its name in errors. most: of more rows, a random sample of so
    many is used. Left out are rows that are outliers for a geometric fit and also FAR away from the middle of all
    errors: what geometry alone does not explain is to be analysed. Raises InputError where the rows do not allow it.
    """
    import numpy as np

    from cellctl.analysis import ErrorSet, UnsuitableRows
    from cellctl.calibration.estimation.identify import registered, rows_together

    total = len(measured.lines)
    chosen = np.sort(np.random.default_rng([seed, 32]).permutation(total)[:most])
    task, rows = measured.task, measured.task.rows.pick(chosen)
    kept, apart = rows_together(task, rows)
    kept |= ~_far(np.concatenate(_errors(rows, registered(task, rows.pick(kept)).state)[1]), kept)
    task = from_prior(measured, model, (), file).task if model else task
    inliers = rows.pick(kept)
    try:
        places, errors = map(np.concatenate, _errors(inliers, registered(task, inliers).state))
        found = ErrorSet.of(measured.readings[chosen[kept]], places, errors)
    except UnsuitableRows as error:
        what, _, cure = str(error).partition(": ")
        raise InputError(Problem(measured.data.file, 0, 0, what, cure)) from error
    left_out = tuple(measured.lines[row] for row in chosen[~kept])
    return RobotErrors(found, total, len(chosen), left_out, apart, measured.rejected)


def _far(errors: Floats, kept: Bools) -> Bools:
    """Which errors (N, 3) are FAR away from the middle of all: in distances of a typical one of those `kept`."""
    import numpy as np

    away = np.linalg.norm(errors - np.median(errors[kept], axis=0), axis=1)
    return np.asarray(away > FAR * np.median(away[kept]))


def _errors(rows: RowBlocks, state: State) -> tuple[list[Floats], list[Floats]]:
    """Nominal TCPs and errors, block after block, each turned into the base frame of its session."""
    places, errors = [], []
    for block in (each for each in rows.blocks if len(each)):
        model = state.models[block.session]
        base = model.chain.base_now
        places.append((model.tcp(block.postures) - base[:3, 3]) @ base[:3, :3])
        errors.append(-block.deviation(state)[:, :3] @ base[:3, :3])
    return places, errors
