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
    from cellctl.kinematics import Floats


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
    many is used. Outliers (as `cellctl fit` finds them) are left out. Raises InputError where the rows do not allow an
    analysis.
    """
    import numpy as np

    from cellctl.analysis import UnsuitableRows
    from cellctl.calibration.estimation.identify import registered, rows_together

    total = len(measured.lines)
    chosen = np.sort(np.random.default_rng([seed, 32]).permutation(total)[:most])
    task, rows = measured.task, measured.task.rows.pick(chosen)
    kept, apart = rows_together(task, rows)
    task = from_prior(measured, model, (), file).task if model else task
    inliers = rows.pick(kept)
    try:
        found = _errors(inliers, registered(task, inliers).state, measured.readings[chosen[kept]])
    except UnsuitableRows as error:
        what, _, cure = str(error).partition(": ")
        raise InputError(Problem(measured.data.file, 0, 0, what, cure)) from error
    left_out = tuple(measured.lines[row] for row in chosen[~kept])
    return RobotErrors(found, total, len(chosen), left_out, apart, measured.rejected)


def _errors(rows: RowBlocks, state: State, readings: Floats) -> ErrorSet:
    """Errors and nominal TCPs of all blocks, each turned into the base frame of its session."""
    import numpy as np

    from cellctl.analysis import ErrorSet

    places, errors = [], []
    for block in (each for each in rows.blocks if len(each)):
        model = state.models[block.session]
        base = model.chain.base_now
        places.append((model.tcp(block.postures) - base[:3, 3]) @ base[:3, :3])
        errors.append(-block.deviation(state)[:, :3] @ base[:3, :3])
    return ErrorSet.of(readings, np.concatenate(places), np.concatenate(errors))
