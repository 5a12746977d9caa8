"""The instrument's settings: reflector, measuring program, target recognition, compensator, atmosphere."""

from __future__ import annotations

from contextlib import suppress
from typing import Final

from geocompy.geo import GeoCom
from geocompy.geo.gcdata import Prism, Target, UserProgram
from geocompy.geo.gcdata import Reflector as ReflectorKind
from geocompy.geo.gctypes import GeoComResponse

from cellctl.devices import DeviceRefused, Reflector, Weather
from drivers.geocom_tracker.air import Exactly, wet_bulb_c
from drivers.geocom_tracker.session import Call, Session

_DIGITS: Final = 15
_PRISM_NAME: Final = "CELLCTL"
_CONSTANT_STEP_MM: Final = 0.0011
"""geocompy writes metres with six decimals."""


async def set_up(device: str, session: Session, reflector: Reflector) -> None:
    """A known state: full digits, the reflector's constant, precise distances, target recognition, lock, compensator.

    Raises DeviceRefused for an instrument that has no such function.
    """
    await session.set(lambda geocom: geocom.com.set_double_precision(_DIGITS))
    await session.set(lambda geocom: geocom.bap.set_target_type(Target.REFLECTOR))
    await _set_reflector(device, session, reflector)
    await _first_known(
        session,
        lambda geocom: geocom.bap.set_measurement_program(UserProgram.SINGLE_REF_PRECISE),
        lambda geocom: geocom.bap.set_measurement_program(UserProgram.SINGLE_REF_STANDARD),
    )
    await _first_known(
        session, lambda geocom: geocom.aus.switch_user_atr(True), lambda geocom: geocom.aut.switch_atr(True)
    )
    await _first_known(  # after target recognition: switching that on ends the lock
        session, lambda geocom: geocom.aus.switch_user_lock(True), lambda geocom: geocom.aut.switch_lock(True)
    )
    await session.set(lambda geocom: geocom.tmc.switch_compensator(True))


async def set_air(session: Session, weather: Weather) -> None:
    """Write the atmosphere with which the instrument corrects distances; its wavelength stays as it is."""
    wavelength, *_ = await session.read(lambda geocom: geocom.tmc.get_atmospheric_corrections())
    numbers = (wavelength, weather.pressure_hpa, weather.temperature_c, wet_bulb_c(weather))

    def written(geocom: GeoCom) -> GeoComResponse[None]:
        return geocom.request(2028, [Exactly(number) for number in numbers])  # TMC_SetAtmCorr

    await session.set(written)


async def _set_reflector(device: str, session: Session, reflector: Reflector) -> None:
    metres = reflector.constant_mm * 1e-3
    await session.set(
        lambda geocom: geocom.bap.set_user_prism_definition(_PRISM_NAME, metres, ReflectorKind.PRISM, "cellctl")
    )
    await _first_known(
        session,
        lambda geocom: geocom.bap.set_prism_type_name(Prism.USER, _PRISM_NAME),
        lambda geocom: geocom.bap.set_prism_type(Prism.USER),
    )
    constant, _, _ = await session.read(lambda geocom: geocom.bap.get_user_prism_definition(_PRISM_NAME))
    if abs(constant - metres) * 1e3 > _CONSTANT_STEP_MM:
        what = f"has the reflector's constant {constant * 1e3:g} mm after {reflector.constant_mm:g} mm was written"
        raise DeviceRefused(device, what, "check the reflector's constant, and the instrument's list of reflectors")


async def _first_known(session: Session, newer: Call[None], older: Call[None]) -> None:
    """The request of newer firmware, or the older one where it is refused."""
    with suppress(DeviceRefused):
        await session.set(newer)
        return
    await session.set(older)
