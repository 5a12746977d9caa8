"""Visits the monument nests: is the station still, and is the reflector the one that its certificate states?"""

from __future__ import annotations

from collections.abc import Mapping
from math import dist
from typing import Any

from cellctl.devices import CellReadings, DeviceFault, PointSource, Vector3
from cellctl.files import InputError
from cellctl.formats.cell_sections import Nest, station_of
from cellctl.procedure import CellContext, NoInputs, StepContext, StepResult, step
from procedures.steps.tracker.instrument import update_weather
from procedures.steps.tracker.measuring import PointInputs
from procedures.steps.tracker.pointing import NestsDisagree, NotSettled, settled_point
from procedures.steps.tracker.rows import NestRow, When


class MonumentsInputs(PointInputs):
    """when: in the campaign. tolerance_mm: displacements of nests up to this count as still."""

    when: When
    tolerance_mm: float = 0.05


class Visited(StepResult):
    """Whether the station is still, and in which session what follows is."""

    verdict: str
    session: str


class Constant(StepResult):
    """How much too large the reflector constant is, mm; None: not checked."""

    error_mm: float | None


def _check_nests(context: CellContext, known: Mapping[str, Any]) -> None:
    nests = station_of(context.cell).nests
    if len(nests) < _LEAST_NESTS:
        what = f"{len(nests)} monument nests, and {_LEAST_NESTS} at least show whether the station moved"
        raise InputError(context.cell.problem(("station",), what, "add nests that are fixed to the floor"))


_LEAST_NESTS = 3


@step(
    "tracker.monuments",
    check=_check_nests,
    needs={"tracker": PointSource},
    uses={"plc": CellReadings},
    errors=(NotSettled, NestsDisagree),
    title="visiting the monuments",
)
async def monuments(context: StepContext, inputs: MonumentsInputs) -> Visited:
    """Measure every nest; a station that moved since the last visit begins a new session, a moving one ends the run."""
    from procedures.steps.tracker.station_motion import MOVED, MOVING, judged_visit, recorded_visits

    await update_weather(context)
    visit = recorded_visits(context)
    await _visit(context, inputs, visit)
    found = await context.clock.compute(judged_visit, context, inputs.tolerance_mm, inputs.when)
    if found.row.verdict == MOVED:
        context.say(f"the station moved by {found.row.shift_mm:.2f} mm: the nests are measured again")
        await _visit(context, inputs, visit)
        found = await context.clock.compute(judged_visit, context, inputs.tolerance_mm, inputs.when)
    await context.record(found.row)
    if found.row.verdict == MOVING:
        what = f"its station is moving: nests moved by {found.row.shift_mm:.2f} mm since the first visit, and still do"
        cure = "stand it firmly, away from sun and draught, let it reach the room's temperature; then begin anew"
        raise DeviceFault("tracker", what, cure)
    if found.station:
        await context.record(found.station)
        context.say(f"the station moved by {found.row.shift_mm:.2f} mm: session {found.station.session} begins")
    return Visited(verdict=found.row.verdict, session=found.row.session)


@step("tracker.check_reflector", title="checking the reflector constant")
async def check_reflector(context: StepContext, inputs: NoInputs) -> Constant:
    """Compare certified distances between nests with the measured ones; refuse a wrong reflector constant."""
    from procedures.steps.tracker.station_motion import constant_row

    row = await context.clock.compute(constant_row, context)
    if row is None:
        context.say("the cell file certifies no distance between nests: the reflector constant is not checked")
        return Constant(error_mm=None)
    await context.record(row)
    if row.wrong:
        what = (
            f"distances between nests show that the reflector constant is {_too_large(row.error_mm)} "
            f"(1 σ {row.sigma_mm:.3f} mm; the instrument's own zero: {row.zero_sigma_mm:.3f} mm): another reflector, "
            "or another constant, than the cell file states"
        )
        raise DeviceFault("tracker", what, "mount the stated reflector, or correct `constant_mm`; then begin anew")
    context.say(
        f"every range is off by {row.error_mm:+.3f} mm (1 σ {row.sigma_mm:.3f} mm), within the instrument's own zero "
        f"(1 σ {row.zero_sigma_mm:.3f} mm): the reflector constant is as stated"
    )
    return Constant(error_mm=row.error_mm)


def _too_large(error_mm: float) -> str:
    return f"{abs(error_mm):.3f} mm too {'large' if error_mm > 0.0 else 'small'}"


async def _visit(context: StepContext, inputs: MonumentsInputs, visit: int) -> None:
    station, tracker = station_of(context.cell), context.device("tracker")
    for nest in station.nests:
        place = nest_place(context, nest)
        point = await settled_point(tracker, context.clock, place, station.search_mm, inputs.settling)
        await context.record(NestRow(visit=visit, nest=nest.id, point=point, attempt=context.attempt))
        _refuse_twice(context, station.search_mm)


def _refuse_twice(context: StepContext, search_mm: float) -> None:
    """Raise NestsDisagree if the last nest is where another nest of this visit is."""
    *others, last = context.recorded(NestRow)
    for row in others:
        apart = dist(row.point.xyz, last.point.xyz)
        if row.visit == last.visit and row.nest != last.nest and apart < search_mm:
            what = f"nests {row.nest} and {last.nest} were measured {apart:.3f} mm apart: one reflector twice"
            cure = f"correct their places in `station: nests:`: each is searched within {search_mm:g} mm"
            raise NestsDisagree("tracker", what, cure)


def nest_place(context: StepContext, nest: Nest) -> Vector3:
    """Where to aim, instrument's frame, mm: where it was measured last, else the cell file's place."""
    import numpy as np

    from procedures.steps.tracker.station import seen_from_instrument

    seen = [row.point.xyz for row in context.recorded(NestRow) if row.nest == nest.id]
    return seen[-1] if seen else seen_from_instrument(context, np.array(nest.xyz))
