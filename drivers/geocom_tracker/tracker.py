"""The laser station: initialise, aim, lock, measure in one or both faces."""

from __future__ import annotations

import math
from collections.abc import Awaitable, Callable
from contextlib import suppress
from typing import Final, TypeVar, cast, final

from geocompy.geo.gcdata import ATR, ATRLock, Inclination, Measurement, Position, PowerSource

from cellctl.clock import Clock
from cellctl.devices import (
    DeviceFault,
    DeviceLost,
    DeviceRefused,
    DeviceUnreachable,
    Health,
    Identity,
    LimitExceeded,
    Lock,
    MeasuredPoint,
    NotLevelled,
    Reflector,
    TargetLost,
    TwoFaceError,
    Vector3,
    Weather,
)
from drivers.geocom_tracker import air
from drivers.geocom_tracker.accuracy import Accuracy
from drivers.geocom_tracker.codes import Meaning, code_of, error_of
from drivers.geocom_tracker.faces import Sample, SetUp, order, point_of, two_face_error_of
from drivers.geocom_tracker.polar import Polar, to_polar
from drivers.geocom_tracker.session import AnswerLost, Session
from drivers.geocom_tracker.settings import set_air, set_up
from drivers.serial_port import SerialPlace

_TURN_S: Final = 60.0
_SEARCH_S: Final = 60.0
_MEASURE_S: Final = 30.0
_EDM_WAIT_S: Final = 10
"""The instrument waits this long for its distance meter before it answers."""
_REGAIN_S: Final = 3.0
_REGAIN_STEP_S: Final = 0.2
_ATTEMPTS: Final = 3
_LOW_BATTERY_PERCENT: Final = 10
_NO_FULL_CORRECTION: Final = 1283
_LOCKS: Final = {ATRLock.NONE: Lock.NONE, ATRLock.LOCK: Lock.LOCKED, ATRLock.PREDICT: Lock.PREDICTED}

Result = TypeVar("Result")


@final
class GeocomTracker:
    """A PointSource: a laser station that speaks GeoCOM with check sums on a serial line.

    All requests are bounded in the cell's time. Reads are repeated if their answer is lost; motions and measurements
    are begun again once, from a known direction and without an old distance, after the instrument has answered again.
    """

    def __init__(self, name: str, place: SerialPlace, clock: Clock, accuracy: Accuracy) -> None:
        self.name = name
        self._place, self._clock, self._accuracy = place, clock, accuracy
        self._session: Session | None = None
        self._reflector: Reflector | None = None
        self._weather: Weather | None = None

    async def connect(self) -> Identity:
        """Open the port, wake the instrument if it sleeps, read its identity."""
        await self.close()
        session = self._session = Session(self.name, self._place, self._clock)
        try:
            await session.ping_ns()
            return await self._identity(session)
        except BaseException as error:
            await self.close()
            if isinstance(error, DeviceLost):
                raise DeviceUnreachable(self.name, f"{error.what} ({self._place})", error.cure) from error
            raise

    async def initialise(self, reflector: Reflector) -> None:
        """Set reflector, measuring program, target recognition, lock and compensator; again whenever it was woken."""
        session = self._connected()
        self._reflector = reflector
        session.on_wake = self._set_up_again
        await self._set_up_again()

    async def set_weather(self, weather: Weather) -> None:
        """Write the air's state. Raises LimitExceeded for values that no workshop has."""
        air.check(self.name, weather)
        await set_air(self._connected(), weather)
        self._weather = weather

    async def aim(self, place: Vector3, search_mm: float) -> None:
        """Turn to `place` in the first face, search within ± `search_mm` across the beam, lock onto the reflector."""
        polar = to_polar(place)
        if not 0.0 < search_mm < polar.range_mm * math.sin(polar.v):
            what = f"cannot search ± {search_mm:g} mm across the beam at {polar.range_mm:.0f} mm"
            raise LimitExceeded(self.name, what, "search a smaller window, and not above or below the instrument")
        await self._once_more(lambda: self._aim(polar, search_mm))

    async def lock(self) -> Lock:
        """Whether it follows the reflector now."""
        return _LOCKS[await self._connected().read(lambda geocom: geocom.mot.get_lockon_status())]

    async def measure(self, samples: int, *, faces: int = 1) -> MeasuredPoint:
        """`samples` in each face, A B b a if there are two; the telescope ends in the first face.

        A beam that is interrupted and back within 3 s is waited for. Raises TargetLost, OutOfRange, NotLevelled.
        """
        if samples < 1 or faces not in (1, 2):
            raise ValueError(f"samples = {samples}, faces = {faces}: measure at least one sample in 1 or 2 faces")
        self._initialised()
        taken = [one for face, count in order(samples, faces) for one in await self._samples(face, count)]
        centring_mm = self._reflector.centring_mm if self._reflector else 0.0
        return point_of(taken, SetUp(self._accuracy, centring_mm, self._weather))

    async def two_face_error(self, samples: int) -> TwoFaceError:
        """Half the difference of `samples` in each face."""
        self._initialised()
        taken = [one for face, count in order(samples, 2) for one in await self._samples(face, count)]
        return two_face_error_of(taken)

    async def levelled(self) -> bool:
        """Whether the compensator is on. Raises NotLevelled if it is out of its range."""
        session = self._connected()
        if not await session.read(lambda geocom: geocom.tmc.get_compensator_status()):
            return False
        answer = await session.answer(lambda geocom: geocom.tmc.get_angle_inclination(Inclination.MEASURE), _MEASURE_S)
        if answer.code == _NO_FULL_CORRECTION:
            code = code_of(22)
            raise NotLevelled(self.name, "has a compensator out of its range (return code 1283)", code.cure)
        return True

    async def health(self) -> Health:
        """Power, internal temperature, the round trip measured now, and counts since connecting."""
        session = self._connected()
        figures: dict[str, float] = {"round_trip_ms": await session.ping_ns() * 1e-6, **_figures(session)}
        try:
            percent, source, _ = await session.read(lambda geocom: geocom.csv.check_power())
            figures["power_percent"] = percent
            figures["internal_c"] = await session.read(lambda geocom: geocom.csv.get_internal_temperature())
        except DeviceFault as fault:
            return Health(False, fault.what, figures)
        external = source is PowerSource.EXTERNAL
        text = f"{'external supply' if external else 'battery'} {percent} %, inside {figures['internal_c']:.1f} °C"
        return Health(external or percent >= _LOW_BATTERY_PERCENT, text + self._noise_note(), figures)

    async def stop(self) -> None:
        """Interrupt a motion or measurement in progress."""
        if self._session and self._session.line.in_flight:
            self._session.line.abort()

    async def close(self) -> None:
        """Interrupt what is in progress and close the port."""
        await self.stop()
        session, self._session = self._session, None
        if session:
            session.close()

    async def _identity(self, session: Session) -> Identity:
        name = await session.read(lambda geocom: geocom.csv.get_instrument_name())
        serial = await session.read(lambda geocom: geocom.csv.get_serial_number())
        firmware = await session.read(lambda geocom: geocom.csv.get_firmware_version())
        geocom_version = await session.read(lambda geocom: geocom.com.get_geocom_version())
        versions = f"{_dotted(firmware)}, GeoCOM {_dotted(geocom_version)}"
        simulated = "SIM" in name.upper()
        return Identity(self.name, str(serial), name + self._noise_note(), versions, simulated)

    def _noise_note(self) -> str:
        return f" (noise of {self._accuracy.name} only)" if self._accuracy.noise_only else ""

    async def _set_up_again(self) -> None:
        session = self._connected()
        if self._reflector:
            await set_up(self.name, session, self._reflector)
        if self._weather:
            await set_air(session, self._weather)

    async def _aim(self, polar: Polar, search_mm: float) -> None:
        session = self._connected()
        hz_window = 2.0 * math.asin(search_mm / (polar.range_mm * math.sin(polar.v)))
        v_window = 2.0 * math.asin(search_mm / polar.range_mm)
        await session.act(lambda geocom: geocom.aut.turn_to(polar.hz, polar.v, Position.PRECISE, ATR.POSITION), _TURN_S)
        await session.act(lambda geocom: geocom.aut.fine_adjust(hz_window, v_window), _SEARCH_S)
        await self._lock_in()

    async def _lock_in(self) -> None:
        await self._connected().act(lambda geocom: geocom.aut.lock_in(), _SEARCH_S)
        if await self.lock() is Lock.NONE:
            raise error_of(self.name, 8725, "AUT_LockIn")

    async def _samples(self, face: int, count: int) -> list[Sample]:
        await self._once_more(lambda: self._turn_over_to(face))
        return [await self._sample() for _ in range(count)]

    async def _turn_over_to(self, face: int) -> None:
        """Change the face if the telescope is in the other one, and lock again if it does not follow."""
        session = self._connected()
        _, v = await session.read(lambda geocom: geocom.tmc.get_angle(Inclination.AUTO), _MEASURE_S)
        if (2 if float(v) > math.pi else 1) != face:
            await session.act(lambda geocom: geocom.aut.change_face(Position.PRECISE, ATR.TARGET), _TURN_S)
        if await self.lock() is Lock.NONE:
            await self._lock_in()

    async def _sample(self) -> Sample:
        for attempt in range(_ATTEMPTS):
            try:
                return await self._once_more(self._measured)
            except TargetLost:
                if attempt == _ATTEMPTS - 1 or not await self._regained():
                    raise
        raise AssertionError("unreachable")

    async def _measured(self) -> Sample:
        """One distance with its angles. The old distance is cleared first, so it cannot be taken for the new one."""
        session = self._connected()
        begun_ns = self._clock.now_ns()
        await session.act(lambda geocom: geocom.tmc.do_measurement(Measurement.CLEAR, Inclination.AUTO), _MEASURE_S)
        await session.act(lambda geocom: geocom.tmc.do_measurement(Measurement.DISTANCE, Inclination.AUTO), _MEASURE_S)
        answer = await session.act(
            lambda geocom: geocom.tmc.get_complete_measurement(_EDM_WAIT_S, Inclination.MEASURE), _MEASURE_S
        )
        code = code_of(answer.code)
        if code.meaning is Meaning.ANGLES_ONLY:
            raise error_of(self.name, answer.code, "TMC_GetFullMeas")
        if answer.params is None:
            raise DeviceFault(self.name, "measured without values", "check its type and firmware")
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

    async def _once_more(self, operation: Callable[[], Awaitable[Result]]) -> Result:
        """The operation, begun again if an answer in it was lost: it begins by what makes the state known."""
        with suppress(AnswerLost):
            return await operation()
        return await operation()

    def _initialised(self) -> None:
        self._connected()
        if self._reflector is None:
            raise DeviceRefused(self.name, "is not initialised: its reflector is not known", "initialise it first")

    def _connected(self) -> Session:
        if self._session is None:
            raise DeviceLost(self.name, "is not connected", "connect it first")
        self._session.line.check()
        return self._session


def _dotted(version: tuple[int, int, int]) -> str:
    return ".".join(str(part) for part in version)


def _figures(session: Session) -> dict[str, float]:
    counts = session.line.counts
    return {
        "requests": counts.requests,
        "missing_answers": counts.missing,
        "garbled_lines": counts.garbled,
        "stray_lines": counts.stray,
        "busy": session.busy,
        "woken": session.woken,
    }
