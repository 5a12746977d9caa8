"""The instrument: reflector, weather, levelling, load; visits to the nests show motion and a wrong reflector."""

from __future__ import annotations

from collections.abc import Mapping
from math import dist
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from cellctl.devices import CellReadings, DeviceFault, PointSource, Reflector, Vector3, Weather
from cellctl.files import Document, InputError
from cellctl.formats import Load, Nest, load_of, reflectors_of, station_of
from cellctl.metrology import TwoFaceLimits, two_face_check
from cellctl.procedure import CellContext, NoInputs, StepContext, StepInputs, StepResult, step
from procedures.steps.tracker.measuring import NotSettled, PointInputs, settled_point
from procedures.steps.tracker.reflectors import NestsDisagree
from procedures.steps.tracker.rows import NestRow, SetUpRow, TwoFaceRow, When
from procedures.steps.tracker.station import (
    MOVED,
    MOVING,
    constant_row,
    judged_visit,
    recorded_visits,
    seen_from_instrument,
)

_NONE = Load(name="none", mass=0.0, xyz=[0.0, 0.0, 0.0])


def recorded_load(document: Document) -> Load:
    """The `load:` of a loaded cell file; without one, nothing is carried. Raises InputError.

    A controller with absolute accuracy is refused: table and option would correct the same error twice.
    """
    load = load_of(document) or _NONE
    if load.absolute_accuracy:
        what = "the controller's absolute accuracy is on: it and a compensation table correct the same errors twice"
        cure = "switch the option off on the controller and write `absolute_accuracy: false`"
        raise InputError(document.problem(("load", "absolute_accuracy"), what, cure))
    return load


class Prepared(StepResult):
    """Whether the instrument is levelled."""

    levelled: bool


def _check_prepare(context: CellContext, known: Mapping[str, Any]) -> None:
    recorded_load(context.cell)
    station_of(context.cell)
    reflectors_of(context.cell)


@step("tracker.prepare", needs={"tracker": PointSource}, uses={"plc": CellReadings}, check=_check_prepare)
async def prepare(context: StepContext, inputs: NoInputs) -> Prepared:
    """Set reflector and weather, check that the instrument is levelled, record load and temperatures.

    To be done again on resume (`on_resume: always`): the instrument may have been off.
    """
    tracker: PointSource = context.device("tracker")
    given, load = reflectors_of(context.cell), recorded_load(context.cell)
    await tracker.initialise(Reflector(given.constant_mm, given.centring_mm, given.acceptance_deg))
    levelled = await tracker.levelled()
    if not levelled:
        raise DeviceFault(tracker.name, "its compensator is off", "level it and switch the compensator on")
    weather = await update_weather(context)
    plc: CellReadings | None = context.optional_device("plc")
    await context.record(
        SetUpRow(
            levelled=levelled,
            weather=weather,
            temperatures=await plc.temperatures() if plc else None,
            load=load.name,
            payload_kg=load.mass,
            payload_xyz=tuple(load.xyz),
            reflector_mm=given.constant_mm,
        )
    )
    if weather is None:
        context.say("the cell has no PLC: the instrument keeps the weather that was set by hand")
    return Prepared(levelled=levelled)


async def update_weather(context: StepContext) -> Weather | None:
    """Write the air's state from the PLC to the instrument; None without a PLC. Raises the devices' errors."""
    plc: CellReadings | None = context.optional_device("plc")
    if plc is None:
        return None
    weather = await plc.weather()
    await context.device("tracker").set_weather(weather)
    return weather


class TwoFaceInputs(StepInputs):
    """samples: in each face. limit_mm: of the error across the beam at a nest."""

    when: When
    samples: Annotated[int, Field(ge=1)] = 2
    limit_mm: Annotated[float, Field(gt=0)] = 0.1


class TwoFaces(StepResult):
    """The largest error across the beam, mm."""

    worst_mm: float


@step("tracker.two_face", needs={"tracker": PointSource})
async def two_face(context: StepContext, inputs: TwoFaceInputs) -> TwoFaces:
    """Measure the first two nests in both faces; refuse an instrument that is out of adjustment, or that changed."""
    tracker: PointSource = context.device("tracker")
    station = station_of(context.cell)
    before = {row.nest: (row.error.hz_mm, row.error.v_mm) for row in context.recorded(TwoFaceRow)}
    found = {}
    for nest in station.nests[:2]:
        await tracker.aim(nest_place(context, nest), station.search_mm)
        error = await tracker.two_face_error(inputs.samples)
        await context.record(TwoFaceRow(when=inputs.when, nest=nest.id, error=error, limit_mm=inputs.limit_mm))
        found[nest.id] = (error.hz_mm, error.v_mm)
    limits = TwoFaceLimits(inputs.limit_mm, inputs.limit_mm)
    earlier = [before[name] for name in found] if before.keys() >= found.keys() else None
    check = two_face_check(list(found.values()), limits, earlier)
    if not check.passed:
        what, _, cure = check.reason.rpartition(": ")
        raise DeviceFault(tracker.name, f"nest {list(found)[check.worst]}: {what}", cure)
    context.say(f"two-face error {check.worst_mm:.3f} mm at most (limit {inputs.limit_mm:g} mm)")
    return TwoFaces(worst_mm=check.worst_mm)


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
)
async def monuments(context: StepContext, inputs: MonumentsInputs) -> Visited:
    """Measure every nest; a station that moved since the last visit begins a new session, a moving one ends the run."""
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


@step("tracker.check_reflector")
async def check_reflector(context: StepContext, inputs: NoInputs) -> Constant:
    """Compare certified distances between nests with the measured ones; refuse a wrong reflector constant."""
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
    seen = [row.point.xyz for row in context.recorded(NestRow) if row.nest == nest.id]
    return seen[-1] if seen else seen_from_instrument(context, np.array(nest.xyz))
