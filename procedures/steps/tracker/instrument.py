"""Prepares the instrument: reflector, weather, levelling; records the load."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import Field

from cellctl.devices import CellReadings, DeviceFault, PointSource, Reflector, Weather
from cellctl.procedure import CellContext, NoInputs, StepContext, StepInputs, StepResult, step
from procedures.steps.tracker.rows import SetUpRow, TwoFaceRow, When


class Prepared(StepResult):
    """Whether the instrument is levelled."""

    levelled: bool


def _check_prepare(context: CellContext, known: Mapping[str, Any]) -> None:
    from cellctl.formats.cell_sections import reflectors_of, station_of
    from procedures.steps.tracker.load import recorded_load

    recorded_load(context.cell)
    station_of(context.cell)
    reflectors_of(context.cell)


@step(
    "tracker.prepare",
    needs={"tracker": PointSource},
    uses={"plc": CellReadings},
    check=_check_prepare,
    title="preparing the instrument",
)
async def prepare(context: StepContext, inputs: NoInputs) -> Prepared:
    """Set reflector and weather, check that the instrument is levelled, record load and temperatures.

    To be done again on resume (`on_resume: always`): the instrument may have been off.
    """
    from cellctl.formats.cell_sections import reflectors_of
    from procedures.steps.tracker.load import recorded_load

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


@step("tracker.two_face", needs={"tracker": PointSource}, title="two-face check")
async def two_face(context: StepContext, inputs: TwoFaceInputs) -> TwoFaces:
    """Measure the first two nests in both faces; refuse an instrument that is out of adjustment, or that changed."""
    from cellctl.formats.cell_sections import station_of
    from cellctl.metrology.instrument_checks import TwoFaceLimits, two_face_check
    from procedures.steps.tracker.monuments import nest_place

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
