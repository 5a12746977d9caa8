"""The laser station: initialise, aim, lock, measure in one or both faces."""

from __future__ import annotations

import math
from typing import Final, final

from geocompy.geo.gcdata import Inclination, PowerSource

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
    TwoFaceError,
    Vector3,
    Weather,
)
from drivers.geocom_tracker import instrument
from drivers.geocom_tracker.codes import code_of
from drivers.geocom_tracker.instrument import MEASURE_S, Telescope, set_air, set_up
from drivers.geocom_tracker.polar_points import Accuracy, Sample, SetUp, order, point_of, to_polar, two_face_error_of
from drivers.geocom_tracker.session import Session
from drivers.serial_port import SerialPlace

_LOW_BATTERY_PERCENT: Final = 10
_TILT: Final = 22
_NO_FULL_CORRECTION: Final = (1283, 1288)


@final
class GeocomTracker:
    """A PointSource: a laser station that speaks GeoCOM with check sums on a serial line.

    All requests are bounded in the cell's time.
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
        self._reflector = self._weather = None
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
        instrument.check_weather(self.name, weather)
        await set_air(self._connected(), weather)
        self._weather = weather

    async def aim(self, place: Vector3, search_mm: float) -> None:
        """Turn to `place` in the first face, search within ± `search_mm` across the beam, lock onto the reflector."""
        polar = to_polar(place)
        if not 0.0 < search_mm < polar.range_mm * math.sin(polar.v):
            what = f"cannot search ± {search_mm:g} mm across the beam at {polar.range_mm:.0f} mm"
            raise LimitExceeded(self.name, what, "search a smaller window, and not above or below the instrument")
        await self._telescope().aim(polar, search_mm)

    async def lock(self) -> Lock:
        """Whether it follows the reflector now."""
        return await self._telescope().lock()

    async def measure(self, samples: int, *, faces: int = 1) -> MeasuredPoint:
        """`samples` in each face, A B b a if there are two; the telescope ends in the first face.

        A beam that is interrupted and back within 3 s is waited for. Raises TargetLost, OutOfRange, NotLevelled.
        """
        if samples < 1 or faces not in (1, 2):
            raise ValueError(f"samples = {samples}, faces = {faces}: measure at least one sample in 1 or 2 faces")
        reflector = self._initialised()
        taken = await self._samples(samples, faces)
        return point_of(taken, SetUp(self._accuracy, reflector.centring_mm, self._weather))

    async def two_face_error(self, samples: int) -> TwoFaceError:
        """Half the difference of `samples` in each face."""
        self._initialised()
        return two_face_error_of(await self._samples(samples, 2))

    async def levelled(self) -> bool:
        """Whether the compensator is on. Raises NotLevelled if it is out of its range."""
        session = self._connected()
        if not await session.read(lambda geocom: geocom.tmc.get_compensator_status()):
            return False
        answer = await session.answer(lambda geocom: geocom.tmc.get_angle_inclination(Inclination.MEASURE), MEASURE_S)
        if answer.code in _NO_FULL_CORRECTION:
            what = f"has a compensator out of its range (return code {answer.code})"
            raise NotLevelled(self.name, what, code_of(_TILT).cure)
        return True

    async def health(self) -> Health:
        """Power, internal temperature, the round trip measured now, and counts since connecting."""
        session = self._connected()
        figures: dict[str, float] = {"latency_ms": await session.ping_ns() * 1e-6, **_figures(session)}
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

    async def _samples(self, samples: int, faces: int) -> list[Sample]:
        telescope = self._telescope()
        return [one for face, count in order(samples, faces) for one in await telescope.samples(face, count)]

    def _telescope(self) -> Telescope:
        return Telescope(self.name, self._connected(), self._clock)

    def _initialised(self) -> Reflector:
        self._connected()
        if self._reflector is None:
            raise DeviceRefused(self.name, "is not initialised: its reflector is not known", "initialise it first")
        return self._reflector

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
