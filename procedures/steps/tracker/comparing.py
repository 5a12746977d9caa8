"""Other models on the poses that identified the robot: what each leaves on the held-out ones."""

from __future__ import annotations

import numpy as np

from cellctl.calibration import FitResult, Split, compared_models, fit
from cellctl.files import InputError
from cellctl.formats import RobotFile, measurements
from cellctl.procedure import StepContext, StepInputs, step
from procedures.steps.identified import held_out_split
from procedures.steps.tracker.identification import kind_of, pose_data
from procedures.steps.tracker.rows import ComparedModelsRow


class CompareInputs(StepInputs):
    """model: the campaign's own. models: those beside it, by the names of `cellctl fit --model`."""

    model: str
    models: tuple[str, ...]


@step("tracker.compare")
async def compare(context: StepContext, inputs: CompareInputs) -> None:
    """Fit other models to the same poses and judge them on the same held-out ones; the table is the campaign's own.

    A model that these rows or this installation cannot fit is left out, with the reason.
    """
    names = tuple(dict.fromkeys((inputs.model, *inputs.models)))
    await context.record(await context.clock.compute(_compared, context, names))


def _compared(context: StepContext, names: tuple[str, ...]) -> ComparedModelsRow:
    robot, (data, _) = RobotFile.load(context.robot_file), pose_data(context)
    choices: list[str] = []
    results: list[FitResult] = []
    left_out: list[str] = []
    split = Split.by_column(np.zeros(0, bool))
    for name in names:
        try:
            measured = measurements(robot, data, measure=kind_of(data), model=name)
            split = held_out_split(measured)
            results.append(fit(measured.task, split))
            choices.append(name)
        except (InputError, ValueError) as error:
            reason = error.problems[0].what if isinstance(error, InputError) else str(error)
            left_out.append(f"{name}: {reason}")
    return ComparedModelsRow(
        models=compared_models(choices, results, split),
        errors=tuple(tuple(result.test_errors.tolist()) for result in results),
        nominal=tuple(results[0].nominal_errors.tolist()) if results else (),
        left_out=tuple(left_out),
    )
