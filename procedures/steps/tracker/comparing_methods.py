"""Methods of compensation on the targets of the run's table: what each leaves in one pass, and how long it takes."""

from __future__ import annotations

import time

import numpy as np
from pydantic import field_validator

from cellctl.compensation import METHODS, compensate
from cellctl.formats import ModelFile, TableFile, compensated_targets, nominal_chain
from cellctl.kinematics import Floats
from cellctl.procedure import StepContext, StepInputs, did_you_mean, step
from cellctl.records import ComputingTimesRow
from procedures.steps.tracker.rows import ComparedMethod, ComparedMethodsRow

_REPEATS = 15
"""Of each timing; the least counts: whatever else the computer does only adds."""


class CompareMethodsInputs(StepInputs):
    """methods: of `cellctl.compensation.METHODS`. table: id of the run's table; None: nothing is compensated."""

    methods: tuple[str, ...]
    table: str | None

    @field_validator("methods")
    @classmethod
    def _known(cls, methods: tuple[str, ...]) -> tuple[str, ...]:
        for method in methods:
            if method not in METHODS:
                raise ValueError(f"there is no compensation method '{method}': {did_you_mean(method, METHODS)}")
        return methods


@step("tracker.compare_methods")
async def compare_methods(context: StepContext, inputs: CompareMethodsInputs) -> None:
    """Compute the targets of the table by each method, with the run's model; the table stays the campaign's own."""
    if inputs.table is None:
        return
    found, times = await context.clock.compute(_compared, context, inputs.methods)
    await context.record(found)
    await context.record(times)


def _compared(context: StepContext, names: tuple[str, ...]) -> tuple[ComparedMethodsRow, ComputingTimesRow]:
    model, table = ModelFile.load(context.artefact("model.json")), TableFile.load(context.artefact("table.json"))
    readings = np.array([row.nominal for row in table.rows])
    targets = nominal_chain(model).forward(model.robot.joint_map().model(readings))
    compared: list[ComparedMethod] = []
    for name in names:
        once = compensated_targets(model, targets, readings, method=name, passes=1)
        whole = compensated_targets(model, targets, readings, method=name)
        compared.append(
            ComparedMethod(
                method=name,
                error_mm=tuple(once.error_mm[-1].tolist()),
                error_deg=tuple(once.error_deg[-1].tolist()),
                passes=whole.passes,
                converged=int(whole.converged.sum()),
            )
        )
        before = once.predicted_before_mm
    return ComparedMethodsRow(methods=tuple(compared), before_mm=tuple(before.tolist())), _timed(
        model, targets, readings, names
    )


def _timed(model: ModelFile, targets: Floats, readings: Floats, names: tuple[str, ...]) -> ComputingTimesRow:
    """Seconds for all targets by one pass of each method, in turns, so that a busy computer slows all alike."""
    nominal, identified, start = nominal_chain(model), model.robot_model(), model.robot.joint_map().model(readings)
    least = dict.fromkeys(names, np.inf)
    for _ in range(_REPEATS):
        for name in names:
            began = time.perf_counter()
            compensate(nominal, identified, targets, start, method=name, passes=1)
            least[name] = min(least[name], time.perf_counter() - began)
    return ComputingTimesRow(what=tuple(least), seconds=tuple(least.values()), repeats=_REPEATS)
