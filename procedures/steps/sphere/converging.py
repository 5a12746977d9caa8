"""How the identification by touches converges: the residuals after each iteration."""

from __future__ import annotations

import numpy as np

from cellctl.calibration import RowBlocks, certified_rows, estimate, fit
from cellctl.formats import DataSet, RobotFile, artefact_of, measurements
from cellctl.kinematics import Floats
from cellctl.procedure import StepContext, step
from procedures.steps.identified import held_out_split
from procedures.steps.sphere.rows import ConvergenceRow
from procedures.steps.sphere.touching import IdentifyInputs


@step("sphere.convergence")
async def convergence(context: StepContext, inputs: IdentifyInputs) -> None:
    """Repeat the run's identification from the nominal robot, and record the residuals after each iteration.

    Its settings are those of `sphere.identify`. All spheres of the held-out touches must be among those of the fit.
    """
    await context.record(await context.clock.compute(_convergence, context, inputs))


def _convergence(context: StepContext, inputs: IdentifyInputs) -> ConvergenceRow:
    measured = measurements(
        RobotFile.load(context.robot_file),
        DataSet.load(context.artefact("dataset.csv")),
        measure="sphere",
        model=inputs.model,
        artefact=artefact_of(context.cell, ("artefact",)),
        use_distances=inputs.use_distances,
    )
    split = held_out_split(measured)
    found = fit(measured.task, split).identification
    used, held_out = measured.task.rows.pick(list(found.used)), measured.task.rows.pick(split.judged[0][1])
    # the last fit of the identification, with its inliers, noise and priors; it may have begun from an earlier fit
    unknowns = found.identified.unknowns
    path: list[Floats] = []
    estimate(unknowns, [*used.noisier(found.noise).blocks, *certified_rows(measured.task)], follow=path.append)

    def errors(rows: RowBlocks) -> list[Floats]:
        return [np.abs(rows.errors(unknowns.state(deviations))) for deviations in path]

    of_fit, of_held_out = errors(used), errors(held_out)
    return ConvergenceRow(
        fit_mean=tuple(float(each.mean()) for each in of_fit),
        fit_max=tuple(float(each.max()) for each in of_fit),
        held_out_mean=tuple(float(each.mean()) for each in of_held_out),
        held_out_max=tuple(float(each.max()) for each in of_held_out),
    )
