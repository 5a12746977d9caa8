"""Other models on the poses that identified the robot: what each leaves on the held-out ones."""

from __future__ import annotations

from dataclasses import asdict

import numpy as np

from cellctl.calibration import fit
from cellctl.calibration.verdict.comparison import Difference
from cellctl.files import InputError
from cellctl.formats import DataSet, RobotFile, measurements
from cellctl.procedure import StepContext, StepInputs, step
from cellctl.records import Figures
from procedures.steps.identified import held_out_split
from procedures.steps.tracker.identification import pose_data
from procedures.steps.tracker.rows import ComparedModel, ComparedModelsRow


class CompareInputs(StepInputs):
    """model: the campaign's own. models: those beside it, by the names of `cellctl fit --model`."""

    model: str
    models: tuple[str, ...]


@step("tracker.compare", title="comparing models")
async def compare(context: StepContext, inputs: CompareInputs) -> None:
    """Fit other models to the same poses and judge them on the same held-out ones; the table is the campaign's own.

    A model that these rows or this installation cannot fit is left out, with the reason.
    """
    names = tuple(dict.fromkeys((inputs.model, *inputs.models)))
    await context.record(await context.clock.compute(_compared, context, names))


def _compared(context: StepContext, names: tuple[str, ...]) -> ComparedModelsRow:
    robot, (data, _) = RobotFile.load(context.robot_file), pose_data(context)
    models: list[ComparedModel] = []
    left_out: list[str] = []
    first = None
    for name in names:
        try:
            measured = measurements(
                robot,
                DataSet.parse(data.text(), "dataset.csv"),
                measure="pose" if data.has("QW") else "position",
                model=name,
            )
            split = held_out_split(measured)
            result = fit(measured.task, split)
        except (InputError, ValueError) as error:
            reason = error.problems[0].what if isinstance(error, InputError) else str(error)
            left_out.append(f"{name}: {reason}")
            continue
        first = first or result
        less = Difference.of(first.test_errors, result.test_errors, split)
        stated = bool(np.isfinite(result.predicted_test_rms))
        models.append(
            ComparedModel(
                choice=name,
                test=Figures(**asdict(result.test)),
                coverage_95=result.coverage_95 if stated else None,
                predicted_rms=result.predicted_test_rms if stated else None,
                less=None if result is first else (less.mean, less.low, less.high),
                errors=tuple(result.test_errors.tolist()),
            )
        )
    nominal = tuple(first.nominal_errors.tolist()) if first else ()
    return ComparedModelsRow(models=tuple(models), nominal=nominal, left_out=tuple(left_out))
