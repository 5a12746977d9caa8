"""Compensates targets with an identified model, and refuses those for which no joints may be given."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, final

from cellctl.files import InputError, Problem
from cellctl.formats import ModelFile, TableFile
from cellctl.formats.table_making import compensated_targets, table_of, target_rows, usual_postures, valid_region
from cellctl.formats.table_refusals import row_problems
from cellctl.formats.targets import Targets
from cellctl.operations.learnt_on import LearntOn

if TYPE_CHECKING:
    from cellctl.compensation import Compensated
    from cellctl.kinematics import Bools


@final
@dataclass(frozen=True, eq=False)
class CompensatedTargets:
    """Targets, and the joints that take the robot of `model` to them by `method`: every target is reached, within the
    joint limits and the measured region.
    """

    model: ModelFile
    wanted: Targets
    method: str
    found: Compensated

    def table(self, learnt: LearntOn, created: str) -> TableFile:
        """The table for the controller `learnt`; created: ISO 8601, a label."""
        return table_of(
            self.model,
            self.wanted.poses,
            self.found,
            serial=learnt.serial,
            simulated=learnt.simulated,
            run=learnt.run,
            created=created,
            method=self.method,
        )


def compensate_targets(
    model: ModelFile, wanted: Targets, file: str, *, method: str = "pseudo-target"
) -> CompensatedTargets:
    """Joints that take the robot of `model` to the targets `wanted`, of `file`.

    Raises InputError with every target that is out of reach or outside the measured region, by its line; and for a
    model that cannot predict a target without further data.
    """
    import numpy as np

    refuse_model(model, file)
    postures = wanted.postures if wanted.postures is not None else usual_postures(model, wanted.poses)
    started = np.asarray(np.isfinite(postures).all(axis=1))
    found = compensated_targets(model, wanted.poses, np.where(started[:, None], postures, 0.0), method=method)
    reached = np.logical_and(started, found.converged)
    if not reached.all():
        raise InputError(_unreachable(wanted, file, reached))
    problems = _refused_rows(model, wanted, file, found)
    if problems:
        raise InputError(problems)
    return CompensatedTargets(model, wanted, method, found)


def refuse_model(model: ModelFile, file: str) -> None:
    """Raise InputError if targets, as those of `file`, lack data that `model` needs for a prediction."""
    from cellctl.calibration import MotorTorsion

    loads = model.load_region
    if loads and loads.min < loads.max and loads.min > 0.0:
        what = f"the model was identified with {loads.min:g} … {loads.max:g} kg, and a table is for no payload"
        raise InputError(Problem(file, 0, 0, what, "identify from rows without payload too"))
    if any(isinstance(effect, MotorTorsion) for effect in model.robot_model().effects):
        what = "the model includes the flexibility by motor current, and a target has no current"
        cure = "identify with --model geometry+compliance, and +backlash where the side of approach is known"
        raise InputError(Problem(file, 0, 0, what, cure))


def _unreachable(wanted: Targets, file: str, reached: Bools) -> list[Problem]:
    cure = "move the target, or give a posture near it as A1…An"
    return [
        Problem(file, line, 0, "the target is out of the robot's reach", cure)
        for line, reachable in zip(wanted.lines, reached, strict=True)
        if not reachable
    ]


def _refused_rows(model: ModelFile, wanted: Targets, file: str, found: Compensated) -> list[Problem]:
    """Errors in rows that must not be sent to a controller of this robot."""
    cure = "move the target, or give another posture for it as A1…An"
    rows = target_rows(model, wanted.poses, found)
    return [
        Problem(file, wanted.lines[row], 0, what, cure)
        for row, reasons in enumerate(row_problems(rows, valid_region(model), model.robot))
        for what in reasons
    ]
