"""What the instrument is set to and told to do: reflector, program, air; turn, search, lock, change face, sample."""

from __future__ import annotations

import math
from collections.abc import Awaitable, Callable
from contextlib import suppress
from typing import Final, TypeVar, cast, final

from geocompy.data import Byte
from geocompy.geo import GeoCom
from geocompy.geo.gcdata import ATR, ATRLock, Inclination, Measurement, Position, Prism, Target, UserProgram
from geocompy.geo.gcdata import Reflector as ReflectorKind
from geocompy.geo.gctypes import GeoComResponse

from cellctl.clock import Clock
from cellctl.devices import DeviceFault, DeviceRefused, LimitExceeded, Lock, Reflector, TargetLost, Weather
from drivers.geocom_tracker.codes import Meaning, code_of, error_of
from drivers.geocom_tracker.polar_points import Polar, Sample
from drivers.geocom_tracker.session import AnswerLost, Call, Session

_BOUNDS: Final = {
    "temperature_c": (-20.0, 60.0, "°C"),
    "pressure_hpa": (500.0, 1100.0, "hPa"),
    "humidity_percent": (0.0, 100.0, "%"),
}
_PSYCHROMETER_PER_K: Final = 6.62e-4
"""Coefficient of a ventilated psychrometer (WMO No. 8)."""

_DIGITS: Final = 15
_PRISM_NAME: Final = "CELLCTL"
_CONSTANT_STEP_MM: Final = 0.0011
"""geocompy writes metres with six decimals."""

MEASURE_S: Final = 30.0
"""Cell time for the answer to a measurement of angles or distance."""
_TURN_S: Final = 60.0
_SEARCH_S: Final = 60.0
_EDM_WAIT_S: Final = 10
"""The instrument waits this long for its distance meter before it answers."""
_REGAIN_S: Final = 3.0
_REGAIN_STEP_S: Final = 0.2
_BEGINNINGS: Final = 3
_REPEATS: Final = 2
"""Interruptions of the beam that one sample may have."""
_LOCKS: Final = {ATRLock.NONE: Lock.NONE, ATRLock.LOCK: Lock.LOCKED, ATRLock.PREDICT: Lock.PREDICTED}

Result = TypeVar("Result")


def check_weather(device: str, weather: Weather) -> None:
    """Raises LimitExceeded for air that no workshop has: a sensor is broken, or the units are wrong."""
    for name, (low, high, unit) in _BOUNDS.items():
        value = getattr(weather, name)
        if not low <= value <= high:
            what = f"weather: {name} = {value:g} is outside {low:g} … {high:g} {unit}; nothing was written"
            raise LimitExceeded(device, what, "check the cell's sensors of the air, and their units")


def wet_bulb_c(weather: Weather) -> float:
    """The wet bulb temperature, by bisection of e = e_s(t_w) − A p (t − t_w)."""
    vapour = weather.humidity_percent / 100.0 * _saturation_hpa(weather.temperature_c)
    low, high = weather.temperature_c - 60.0, weather.temperature_c
    for _ in range(50):
        wet = (low + high) / 2.0
        excess = _saturation_hpa(wet) - _PSYCHROMETER_PER_K * weather.pressure_hpa * (weather.temperature_c - wet)
        low, high = (wet, high) if excess < vapour else (low, wet)
    return (low + high) / 2.0


def _saturation_hpa(temperature_c: float) -> float:
    """Vapour pressure over water, Magnus' formula (WMO No. 8)."""
    return 6.112 * math.exp(17.62 * temperature_c / (243.12 + temperature_c))


@final
class Exactly(Byte):
    """A number that geocompy writes as it is. It writes a float with six decimals: a wavelength of 6.58e-7 is lost."""

    def __init__(self, number: float) -> None:
        self._number = number

    def __str__(self) -> str:
        return repr(self._number)


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


@final
class Telescope:
    """The telescope of a connected instrument. Raises every DeviceError.

    Where the answer to a motion or measurement is lost, the operation is begun again, twice at most: from a stated
    direction, from the face that the instrument reads, or with the old distance cleared.
    """

    def __init__(self, device: str, session: Session, clock: Clock) -> None:
        self._device, self._session, self._clock = device, session, clock

    async def aim(self, polar: Polar, search_mm: float) -> None:
        """Turn in the first face, search within ± `search_mm` across the beam, lock."""
        await self._begun_again(lambda: self._aim(polar, search_mm))

    async def _aim(self, polar: Polar, search_mm: float) -> None:
        hz_window = 2.0 * math.asin(search_mm / (polar.range_mm * math.sin(polar.v)))
        v_window = 2.0 * math.asin(search_mm / polar.range_mm)
        await self._session.act(
            lambda geocom: geocom.aut.turn_to(polar.hz, polar.v, Position.PRECISE, ATR.POSITION), _TURN_S
        )
        await self._session.act(lambda geocom: geocom.aut.fine_adjust(hz_window, v_window), _SEARCH_S)
        await self._lock_in()

    async def lock(self) -> Lock:
        """Whether it follows the reflector."""
        return _LOCKS[await self._session.read(lambda geocom: geocom.mot.get_lockon_status())]

    async def _lock_in(self) -> None:
        await self._session.act(lambda geocom: geocom.aut.lock_in(), _SEARCH_S)
        if await self.lock() is Lock.NONE:
            raise error_of(self._device, 8725, "AUT_LockIn")

    async def samples(self, face: int, count: int) -> list[Sample]:
        """Take this many samples in this face."""
        await self._begun_again(lambda: self._turn_over_to(face))
        return [await self._sample() for _ in range(count)]

    async def _turn_over_to(self, face: int) -> None:
        """Change the face if the telescope is in the other one, and lock again if it does not follow."""
        _, v = await self._session.read(lambda geocom: geocom.tmc.get_angle(Inclination.AUTO), MEASURE_S)
        if (2 if float(v) > math.pi else 1) != face:
            await self._session.act(lambda geocom: geocom.aut.change_face(Position.PRECISE, ATR.TARGET), _TURN_S)
        if await self.lock() is Lock.NONE:
            await self._lock_in()

    async def _sample(self) -> Sample:
        for _ in range(_REPEATS):
            try:
                return await self._begun_again(self._measured)
            except TargetLost:
                if not await self._regained():
                    raise
        return await self._begun_again(self._measured)

    async def _measured(self) -> Sample:
        """One distance with its angles. The old distance is cleared first, so it cannot be taken for the new one."""
        begun_ns = self._clock.now_ns()
        await self._session.act(
            lambda geocom: geocom.tmc.do_measurement(Measurement.CLEAR, Inclination.AUTO), MEASURE_S
        )
        await self._session.act(
            lambda geocom: geocom.tmc.do_measurement(Measurement.DISTANCE, Inclination.AUTO), MEASURE_S
        )
        answer = await self._session.act(
            lambda geocom: geocom.tmc.get_complete_measurement(_EDM_WAIT_S, Inclination.MEASURE), MEASURE_S
        )
        code = code_of(answer.code)
        if code.meaning is Meaning.ANGLES_ONLY:
            raise error_of(self._device, answer.code, "TMC_GetFullMeas")
        if answer.params is None:
            raise DeviceFault(self._device, "measured without values", "check its type and firmware")
        hz, v, *_, metres, device_ms = cast("tuple[float, ...]", answer.params)  # geocompy declares three of the eight
        reading = Polar(float(hz), float(v), metres * 1e3)
        warning = code.what if code.meaning is Meaning.WARNING else ""
        return Sample(reading, answer.code, warning, round(device_ms), begun_ns, self._clock.now_ns())

    async def _regained(self) -> bool:
        """Whether the instrument follows the reflector again before its prediction ends."""
        give_up_ns = self._clock.now_ns() + round(_REGAIN_S * 1e9)
        while (state := await self.lock()) is Lock.PREDICTED and self._clock.now_ns() < give_up_ns:
            await self._clock.sleep(_REGAIN_STEP_S)
        return state is Lock.LOCKED

    async def _begun_again(self, operation: Callable[[], Awaitable[Result]]) -> Result:
        """The operation, begun again if an answer in it was lost: it begins by what makes the state known."""
        for _ in range(_BEGINNINGS - 1):
            with suppress(AnswerLost):
                return await operation()
        return await operation()
