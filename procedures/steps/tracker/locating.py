"""Finds where the instrument is from the nests, whose rough places the cell file has."""

from __future__ import annotations

from cellctl.procedure import NoInputs, StepContext, StepResult, step
from procedures.steps.tracker.rows import NestRow, StationRow


class Located(StepResult):
    """The largest distance of a measured nest from the cell file's place, mm, with the instrument at its new place."""

    residual_mm: float


@step("tracker.locate", title="locating the instrument")
async def locate(context: StepContext, inputs: NoInputs) -> Located:
    """Carry the measured nests to their places in the cell file; so reflectors are aimed at more closely."""
    row, residual = await context.clock.compute(_located, context)
    await context.record(row)
    x, y, z = (line[3] for line in row.matrix[:3])
    context.say(f"instrument at {x:.0f}, {y:.0f}, {z:.0f} mm; nests up to {residual:.1f} mm from their rough places")
    return Located(residual_mm=residual)


def _located(context: StepContext) -> tuple[StationRow, float]:
    import numpy as np

    from cellctl.calibration.estimation.registration import rigid_fit
    from cellctl.formats.cell_sections import station_of
    from procedures.steps.tracker.station import session_now

    given = {nest.id: np.array(nest.xyz, float) for nest in station_of(context.cell).nests}
    measured = {row.nest: np.array(row.point.xyz) for row in context.recorded(NestRow)}
    there, here = (np.array([places[name] for name in given]) for places in (given, measured))
    matrix = rigid_fit(here, there)
    residual = float(np.linalg.norm(here @ matrix[:3, :3].T + matrix[:3, 3] - there, axis=1).max())
    row = StationRow(session=session_now(context), source="nests", matrix=tuple(map(tuple, matrix.tolist())))
    return row, residual
