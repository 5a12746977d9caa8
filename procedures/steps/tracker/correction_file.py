"""The correction model of a run, at the load and the temperature of the cell."""

from __future__ import annotations

import numpy as np

from cellctl.calibration import Postures
from cellctl.files import InputError
from cellctl.formats import ModelFile
from cellctl.formats.load import load_of
from cellctl.formats.online import CorrectionFile
from cellctl.procedure import StepContext

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
