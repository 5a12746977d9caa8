"""Model files of a campaign: an earlier run's model, refused for another robot, and the correction model of a run."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from cellctl.calibration import Postures
from cellctl.devices import table_correction_deg
from cellctl.files import InputError, Problem
from cellctl.formats import CorrectionFile, ModelFile, RobotFile, load_of
from cellctl.journal import run_place
from cellctl.operations.campaign_services import (
    CellRobot,
    ModelController,
    refuse_model,
    refuse_other_cell,
    stated_controller,
)
from cellctl.procedure import CellContext, StepContext
from procedures.steps.tracker.rows import MODEL_FILE, ReadModelRow


def check_model(context: CellContext, known: Mapping[str, Any], of_reflector: bool = False) -> None:
    """What `read_model_of` would refuse, without a controller: `known` has `run`, and may have `file`."""
    run, file = str(known.get("run", "")), str(known.get("file", ""))
    if run or file:
        _model_of(context, run, file, of_reflector)


def read_model_of(context: StepContext, run: str, file: str = "", of_reflector: bool = False) -> ReadModelRow:
    """The model of the run in folder `run`, or of that name beside this run; or the model in `file`.

    of_reflector: its tool has to be the reflector, which a model from touches does not have. A model that does not
    state its controller is taken for that of this cell. Raises InputError without one, and for a model of another
    controller, robot or tool, or one that cannot predict a target.
    """
    path, model = _model_of(context, run, file, of_reflector)
    own = context.identity("robot")
    found = stated_controller(path, model) or ModelController(own.serial, own.simulated, None)
    if found.serial != own.serial:
        what = f"was identified on controller '{found.serial}', and this one is '{own.serial}'"
        raise InputError(Problem(str(path), 0, 0, what, "name a run on this robot"))
    return ReadModelRow(run=found.run or path.stem, serial=found.serial, text=path.read_text(encoding="utf-8"))


def _model_of(context: CellContext, run: str, file: str, of_reflector: bool) -> tuple[Path, ModelFile]:
    """The file of the model and its content, compared with the cell's robot. Raises InputError."""
    if run and file:
        what = "a run and a model file are named, and one model compensates"
        raise InputError(Problem("--set model_file", 0, 0, what, "name the run or the file"))
    path = Path(file) if file else run_place(Path(run), context.runs) / "model.json"
    if run and not path.is_file():
        there = path.parent.is_dir()
        what = "has no model: it identified none, or ended before" if there else f"there is no run '{run}'"
        raise InputError(Problem(str(path.parent), 0, 0, what, "`cellctl runs` lists the runs"))
    model = ModelFile.load(path)
    robot = RobotFile.load(context.robot_file)
    refuse_other_cell(model, str(path), CellRobot(robot, table_correction_deg(context.cell)))
    refuse_model(model, str(path))
    if of_reflector and model.frame_of_points:
        what = "is a model from touches: its tool is what touched, and no reflector is in it"
        cure = "identify from an instrument's poses; `cellctl run sphere_by_tracker` judges a model from touches"
        raise InputError(Problem(str(path), 0, 0, what, cure))
    return path, model


def read_model(context: StepContext) -> ModelFile | None:
    """The model that this run read, from its run folder; None without one."""
    read = context.recorded(ReadModelRow)
    return ModelFile.load(context.artefact(MODEL_FILE)) if read else None


REFERENCE_C = 20.0
"""The temperature at which a model's lengths hold."""


def correction_file(context: StepContext, arm_c: float | None) -> CorrectionFile:
    """Of `model.json` in the run folder. Raises InputError for a model that cannot be applied on-line."""
    model = ModelFile.load(context.artefact("model.json"))
    load = load_of(context.cell)
    at = Postures(
        np.zeros((1, model.robot.n)),
        delta_t=None if arm_c is None else np.array([arm_c - REFERENCE_C]),
        payload=np.array([load.mass]) if load else None,
        payload_at=np.array([load.xyz]) if load else None,
    )
    try:
        return CorrectionFile.of(model, at)
    except ValueError as error:
        raise InputError(context.cell.problem((), str(error), "identify a model without it (--set model=…)")) from error
