"""Reads the model that an earlier run identified."""

from __future__ import annotations

from pathlib import Path

from cellctl.files import InputError, Problem
from cellctl.formats import ModelFile
from cellctl.journal import run_place
from cellctl.operations.learnt_on import learnt_on
from cellctl.procedure import StepContext
from procedures.steps.iso9283.rows import ReadModelRow


def read_model_of(context: StepContext, run: str) -> ReadModelRow:
    """The model of the run in folder `run`, or of that name beside this run.

    Raises InputError without one, and for a model of another controller.
    """
    file = run_place(Path(run), context.run_folder.parent) / "model.json"
    model = ModelFile.load(file)
    found, own = learnt_on(file, model, None), context.identity("robot").serial
    if found.serial != own:
        what = f"was identified on controller '{found.serial}', and this one is '{own}'"
        raise InputError(Problem(str(file), 0, 0, what, "name a run on this robot"))
    return ReadModelRow(run=file.parent.name, serial=found.serial, text=file.read_text(encoding="utf-8"))
