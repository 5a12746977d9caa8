"""Compensates targets with an identified model of a known controller, and compares the methods on one model."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Self, final

import numpy as np

from cellctl.calibration import MotorTorsion
from cellctl.compensation import METHODS, Compensated, PredictedErrors
from cellctl.devices.cell import Cell
from cellctl.devices.registry import DriverRegistry
from cellctl.files import InputError, Problem
from cellctl.formats import ModelFile, RobotFile, TableFile
from cellctl.formats.table import Row, other_robot, row_problems
from cellctl.formats.table_export import compensated_csv
from cellctl.formats.table_making import (
    compensated_targets,
    mean_rms_max,
    table_of,
    target_rows,
    usual_postures,
    valid_region,
)
from cellctl.formats.targets import Targets
from cellctl.journal import fold, read_journal
from cellctl.kinematics import Floats

SIMULATED_SERIAL = "SIM-"
"""Prefix of a simulated controller's serial (docs/reference/eki-channel.md)."""


@final
@dataclass(frozen=True, slots=True)
class ModelController:
    """The controller that a table is for, whether its model was identified on a simulator, and in which run."""

    serial: str
    simulated: bool
    run: str | None


def controller_of_model(path: Path | None, model: ModelFile, serial: str | None) -> ModelController:
    """The controller of the model in file `path` (None: it is in no file): from its provenance, else the journal in its
    folder, else `serial`.

    Raises InputError if none of these states it, or if `serial` differs from the model's controller: a model is valid
    only for the robot, or simulator, on which it was identified.
    """
    if serial is not None and not serial.strip():
        raise InputError(Problem("--serial", 0, 0, "is empty", "give the serial number that the controller shows"))
    found = stated_controller(path, model)
    name = str(path or "the model")
    if found is None and serial is None:
        what = "does not say on whose controller it was learnt"
        raise InputError(Problem(name, 0, 0, what, "give its serial with --serial"))
    if found is None:
        assert serial is not None
        return ModelController(serial, serial.startswith(SIMULATED_SERIAL), None)
    if serial is not None and serial != found.serial:
        what = f"'{serial}', but {name} was learnt on controller '{found.serial}'"
        raise InputError(Problem("--serial", 0, 0, what, "leave --serial out, or give this robot's own model"))
    return found


def stated_controller(path: Path | None, model: ModelFile) -> ModelController | None:
    """The controller that the model's provenance states, else the journal in its folder; None if neither does."""
    return _by_provenance(model, path) or (_by_journal(path.parent) if path else None)


def _by_provenance(model: ModelFile, path: Path | None) -> ModelController | None:
    serial = model.provenance.get("robot_serial")
    if serial is None:
        return None
    run = model.provenance.get("run") or (_run_of(path.parent) if path else None)
    return ModelController(serial, serial.startswith(SIMULATED_SERIAL), run)


def _by_journal(folder: Path) -> ModelController | None:
    """The only device with axes of the run in `folder`; every step calls it robot."""
    if not (folder / "journal.sqlite").exists():
        return None
    identity = fold(read_journal(folder)).identities.get("robot")
    return ModelController(str(identity["serial"]), bool(identity["simulated"]), _run_of(folder)) if identity else None


def _run_of(folder: Path) -> str | None:
    return folder.resolve().name if (folder / "journal.sqlite").exists() else None


OUT_OF_REACH = "the target is out of the robot's reach within the measured joints"

_CURE = "move the target, or give another posture near it as A1…An"
_METRES = "all targets lie within 20 mm of the frame's origin: X, Y, Z are mm; if these are metres, multiply by 1000"


@final
@dataclass(frozen=True, slots=True)
class CellRobot:
    """The robot file of a cell, and the largest correction of a joint that the cell allows, deg."""

    robot: RobotFile
    correction_deg: float

    @classmethod
    def load(cls, path: Path) -> Self:
        """Of the cell file `path`; opens no device. Raises InputError."""
        cell = Cell.load(path, DriverRegistry())
        return cls(RobotFile.load(cell.robot_file), cell.table_correction_deg)


@final
@dataclass(frozen=True, eq=False)
class CompensatedTargets:
    """Targets, and the joints that take the robot of `model` to them: every target is reached, within the joint limits
    and the measured region. passes: those asked for, None: until the targets are reached.
    """

    model: ModelFile
    wanted: Targets
    method: str
    passes: int | None
    found: Compensated
    errors: PredictedErrors | None = None

    @cached_property
    def rows(self) -> list[Row]:
        """Target, joints, predicted errors and σ, rounded as in a table."""
        return target_rows(self.model, self.wanted.poses, self.found, self.errors)

    @cached_property
    def exact_rows(self) -> list[Row]:
        """The same in full precision."""
        return target_rows(self.model, self.wanted.poses, self.found, self.errors, exact=True)

    def table(self, controller: ModelController, created: str) -> TableFile:
        """The table for the `controller`; created: ISO 8601, a label."""
        made = "" if self.passes is None else f", {self.passes} pass{'' if self.passes == 1 else 'es'}"
        return table_of(
            self.model,
            self.wanted.poses,
            self.found,
            serial=controller.serial,
            simulated=controller.simulated,
            run=controller.run,
            created=created,
            method=f"{self.method}{made}",
            errors=self.errors,
        )

    def csv(self) -> str:
        """The rows as CSV."""
        return compensated_csv(self.model, self.rows)


def compensate_targets(
    model: ModelFile,
    wanted: Targets,
    file: str,
    *,
    method: str = "pseudo-target",
    passes: int | None = None,
    errors: PredictedErrors | None = None,
    correction_deg: float = math.inf,
) -> CompensatedTargets:
    """Joints that take the robot of `model` to the targets `wanted`, of `file`.

    method, passes, errors: as in `compensated_targets`. correction_deg: the largest correction of a joint.

    Raises InputError with every target that is not reached, is outside the measured region or the joint limits, or
    needs a larger correction, by its line; and for a model that cannot predict a target without further data.
    """
    refuse_model(model, file)
    tried = try_targets(model, wanted, method=method, passes=passes, errors=errors, correction_deg=correction_deg)
    cure = _METRES if float(abs(wanted.poses[:, :3, 3]).max()) < 20.0 else _CURE
    if refused := [Problem(file, line, 0, what, cure) for line, what in tried.refused()]:
        raise InputError(refused)
    return CompensatedTargets(model, wanted, method, passes, tried.found, errors)


@final
@dataclass(frozen=True, eq=False)
class Tried:
    """Targets as compensated, with the reasons (N,) against each; a target without any may be sent to the robot.

    seconds: to find the joints.
    """

    wanted: Targets
    found: Compensated
    reasons: list[list[str]]
    seconds: float

    def refused(self) -> list[tuple[int, str]]:
        """Line and reason, for every reason."""
        pairs = zip(self.wanted.lines, self.reasons, strict=True)
        return [(line, reason) for line, reasons in pairs for reason in reasons]


def try_targets(
    model: ModelFile,
    wanted: Targets,
    *,
    method: str,
    passes: int | None = None,
    errors: PredictedErrors | None = None,
    correction_deg: float = math.inf,
) -> Tried:
    """Compensate what can be; the others have their reasons. Arguments as in `compensate_targets`."""
    postures = wanted.postures if wanted.postures is not None else usual_postures(model, wanted.poses)
    started = np.asarray(np.isfinite(postures).all(axis=1))
    start = np.where(np.isfinite(postures), postures, 0.0)
    began = time.perf_counter()
    found = compensated_targets(model, wanted.poses, start, method=method, passes=passes, errors=errors)
    seconds = time.perf_counter() - began
    rows = target_rows(model, wanted.poses, found, errors)
    of_rows = row_problems(rows, valid_region(model), model.robot, correction_deg)
    reasons = [
        ([reason] if reason else row) if known else [OUT_OF_REACH]
        for known, reason, row in zip(started.tolist(), found.reasons, of_rows, strict=True)
    ]
    return Tried(wanted, found, reasons, seconds)


def refuse_model(model: ModelFile, file: str) -> None:
    """Raise InputError if targets, as those of `file`, lack data that `model` needs for a prediction, or its robot has
    a prismatic joint.
    """
    model.robot.refuse_prismatic(file, "a compensation")
    loads = model.load_region
    if loads and loads.min < loads.max and loads.min > 0.0:
        what = f"the model was identified with {loads.min:g} … {loads.max:g} kg, and a table is for no payload"
        raise InputError(Problem(file, 0, 0, what, "identify from rows without payload too"))
    if any(isinstance(effect, MotorTorsion) for effect in model.robot_model().effects):
        what = "the model includes the flexibility by motor current, and a target has no current"
        cure = "identify with --model geometry+compliance, and +backlash where the side of approach is known"
        raise InputError(Problem(file, 0, 0, what, cure))


def refuse_other_cell(model: ModelFile, file: str, cell: CellRobot) -> None:
    """Raise InputError if `model`, of `file`, is not for the robot and the tool of `cell`."""
    found = []
    for what in other_robot(model.robot.name, model.robot.tool, cell.robot):
        tool = "tool" in what
        cure = "identify the new tool: `cellctl fit … --prior MODEL --free tool`" if tool else "give this robot's model"
        found.append(Problem(file, 0, 0, what + (": the model is older than the tool" if tool else ""), cure))
    if not found and _kinematics(model.robot) != _kinematics(cell.robot):
        what = "links, joints or mounting of the cell's robot file were changed after the model was identified"
        found.append(Problem(file, 0, 0, what, "identify again with this robot file"))
    if found:
        raise InputError(found)


def _kinematics(robot: RobotFile) -> object:
    joints = [(joint.sign, joint.offset) for joint in robot.joints]
    return robot.convention, robot.links, robot.screws, robot.home, joints, robot.mounting


@final
@dataclass(frozen=True, slots=True)
class Accuracy:
    """Predicted distances (mm) and angles (deg) from the targets: mean, RMS, max."""

    position_mm: dict[str, float]
    orientation_deg: dict[str, float]


@final
@dataclass(frozen=True, slots=True)
class UnreachedTarget:
    """Line of a target that is not reached, and why."""

    line: int
    reason: str


@final
@dataclass(frozen=True, slots=True)
class MethodFigures:
    """One method on all targets.

    targets, reached: their counts; unreached: line and reason of each of the others. before, one_pass, iterated: at the
    nominal joints, after one pass, and repeated to the tolerance, over the targets that are reached; None where none
    is. per_pass_mm: mean error before the first pass and after each. position_only: the orientation is not compensated.
    repeats: whether a further pass changes anything. seconds_per_target: to find the joints, with the inverse.
    """

    method: str
    targets: int
    reached: int
    unreached: tuple[UnreachedTarget, ...]
    before: Accuracy | None
    one_pass: Accuracy | None
    iterated: Accuracy | None
    per_pass_mm: list[float]
    position_only: bool
    repeats: bool
    seconds_per_target: float


def compare_methods(model: ModelFile, wanted: Targets, file: str, correction_deg: float) -> list[MethodFigures]:
    """Every method on the targets `wanted`, of `file`; correction_deg: the largest correction of a joint.

    Raises InputError for a model that cannot predict a target without further data.
    """
    refuse_model(model, file)
    return [_figures(model, wanted, method, correction_deg) for method in METHODS]


def _figures(model: ModelFile, wanted: Targets, method: str, correction_deg: float) -> MethodFigures:
    once = try_targets(model, wanted, method=method, passes=1, correction_deg=correction_deg)
    tried = try_targets(model, wanted, method=method, correction_deg=correction_deg)
    good = np.array([not reasons for reasons in tried.reasons])
    rows, after_one = good & np.array([not reasons for reasons in once.reasons]), _last(once)
    per_pass = tried.found.error_mm[:, good]
    return MethodFigures(
        method=method,
        targets=len(good),
        reached=int(good.sum()),
        unreached=tuple(UnreachedTarget(*each) for each in tried.refused()),
        before=_accuracy(tried.found.error_mm[0][good], tried.found.error_deg[0][good]),
        one_pass=_accuracy(*(each[rows] for each in after_one)),
        iterated=_accuracy(*(each[good] for each in _last(tried))),
        per_pass_mm=per_pass.mean(axis=1).tolist() if good.any() else [],
        position_only=tried.found.position_only,
        repeats=METHODS[method].write_back is None,
        seconds_per_target=tried.seconds / max(len(good), 1),
    )


def _last(tried: Tried) -> tuple[Floats, Floats]:
    """Distance and angle (N,) after the last pass."""
    return tried.found.error_mm[-1], tried.found.error_deg[-1]


def _accuracy(millimetres: Floats, degrees: Floats) -> Accuracy | None:
    return Accuracy(mean_rms_max(millimetres), mean_rms_max(degrees)) if len(millimetres) else None
