"""The model of an earlier run: reads it, and registers it to the instrument of this run."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from cellctl.procedure import CellContext, NoInputs, StepContext, StepInputs, StepResult, step
from procedures.steps.judged import Judged
from procedures.steps.tracker.rows import MODEL_FILE, ReadModelRow, TrackerVerdict


class ReadModelInputs(StepInputs):
    """run: folder of the run whose model compensates, or its name beside this run. file: a model file. Both empty: none
    is read.
    """

    run: str = ""
    file: str = ""


class ReadModel(StepResult):
    """Whether a model was read."""

    found: bool


def _check_model(context: CellContext, known: Mapping[str, Any]) -> None:
    from procedures.steps.tracker.model_reading import check_model

    check_model(context, known, of_reflector=True)


@step("tracker.read_model", check=_check_model, reads_files=True, title="reading the model")
async def read_model(context: StepContext, inputs: ReadModelInputs) -> ReadModel:
    """Read the model of an earlier run, if one is named; refuse that of another controller, robot or tool."""
    from procedures.steps.tracker.model_reading import read_model_of

    named = bool(inputs.run or inputs.file)
    if named:
        row = await context.clock.compute(read_model_of, context, inputs.run, inputs.file, True)
        await context.record(row)
        await context.write_artefact(MODEL_FILE, row.text)
    else:
        context.say("no model is named: one is identified first")
    return ReadModel(found=named)


@step("tracker.register", verdict=TrackerVerdict, title="registering the model")
async def register(context: StepContext, inputs: NoInputs) -> Judged:
    """Find the instrument in the frame of the model that was read, and judge that model on the held-out poses."""
    from procedures.steps.identified import write_and_record
    from procedures.steps.tracker.registering import registered_model

    await context.write_artefact(MODEL_FILE, context.recorded(ReadModelRow)[-1].text)
    return await write_and_record(context, await context.clock.compute(registered_model, context))
