"""What the telescope does: turn, search, lock, change the face, take a sample."""

from __future__ import annotations

import math
from collections.abc import Awaitable, Callable
from contextlib import suppress
from typing import Final, TypeVar, cast, final

from geocompy.geo.gcdata import ATR, ATRLock, Inclination, Measurement, Position

from cellctl.clock import Clock
from cellctl.devices import DeviceFault, Lock, TargetLost
from drivers.geocom_tracker.codes import Meaning, code_of, error_of
from drivers.geocom_tracker.faces import Sample
from drivers.geocom_tracker.polar import Polar
from drivers.geocom_tracker.session import AnswerLost, Session

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
