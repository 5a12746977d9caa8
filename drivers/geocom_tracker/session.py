"""A session with the instrument: requests are repeated where that is safe, waits are bounded, a sleeper is woken."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Any, Final, Generic, TypeVar, final

from geocompy.geo import GeoCom
from geocompy.geo.gctypes import GeoComResponse

from cellctl.clock import Clock
from cellctl.devices import DeviceError, DeviceFault, DeviceLost, DeviceRefused
from drivers.geocom_tracker.codes import Meaning, code_of, error_of
from drivers.geocom_tracker.line import Library, Line
from drivers.serial_port import SerialPlace, open_port

READ_S: Final = 5.0
"""Cell time for the answer to a read or a setting."""
_SENDINGS: Final = 3
_BUSY_S: Final = 10.0
_ASK_AGAIN_S: Final = 0.25
_WAKE_S: Final = 20.0
_SILENT_CURE: Final = "check the instrument's supply and cable, and that it speaks GeoCOM at this baud rate"

Params = TypeVar("Params")
Call = Callable[[GeoCom], GeoComResponse[Params]]


class AnswerLost(DeviceLost):
    """The answer to a motion or measurement was lost; the instrument answers again and is at rest."""


@final
@dataclass(frozen=True, slots=True)
class Answer(Generic[Params]):
    """The parameters of an answer, and its return code: done or a warning."""

    params: Params
    code: int


@final
class Session:
    """An open line with geocompy on it. `on_wake`: called when the instrument had to be woken, to set it up again."""

    def __init__(self, device: str, place: SerialPlace, clock: Clock) -> None:
        self.line = Line(device, open_port(device, place), clock)
        self.on_wake: Callable[[], Awaitable[None]] | None = None
        self.woken = 0
        self.busy = 0
        self._device, self._clock = device, clock
        self._library = Library(device, self.line, clock)
        self._waking = False

    async def read(self, call: Call[Params], within_s: float = READ_S) -> Params:
        """The parameters that a request returns. Repeated if its answer is lost: it must change nothing or one value.

        within_s: of the cell's time. Raises every DeviceError.
        """
        answer = await self.answer(call, within_s)
        if answer.params is None:
            raise DeviceFault(self._device, "answered without the expected values", "check its type and firmware")
        return answer.params

    async def answer(self, call: Call[Params], within_s: float = READ_S) -> Answer[Params]:
        """As `read`, with the return code, which may be a warning; the parameters may be None."""
        return await self._asked(call, within_s, repeatable=True)

    async def set(self, call: Call[None], within_s: float = READ_S) -> None:
        """A setting. Repeated if its answer is lost."""
        await self._asked(call, within_s, repeatable=True)

    async def act(self, call: Call[Params], within_s: float) -> Answer[Params]:
        """A motion or measurement: never repeated blindly; cancelling it interrupts the motion.

        Raises AnswerLost if its answer was lost.
        """
        try:
            return await self._asked(call, within_s, repeatable=False)
        except asyncio.CancelledError:
            self.line.abort()
            raise

    async def ping_ns(self) -> int:
        """Time from sending a request that does nothing to its answer."""
        sent_ns = self._clock.now_ns()
        await self.set(lambda geocom: geocom.com.nullprocess())
        return self._clock.now_ns() - sent_ns

    def close(self) -> None:
        """End the thread, close the port."""
        self._library.close()
        self.line.close()

    async def _asked(self, call: Call[Any], within_s: float, *, repeatable: bool) -> Answer[Any]:
        unanswered, give_up_ns = 0, self._clock.now_ns() + round(_BUSY_S * 1e9)
        while True:
            response = await self._library.call(call, within_s)
            number = int(response.error)
            error = error_of(self._device, number, response.rpcname)
            match code_of(number).meaning:
                case Meaning.DONE | Meaning.WARNING | Meaning.ANGLES_ONLY:
                    return Answer(response.params, number)
                case Meaning.NOT_HEARD | Meaning.ANSWER_LOST as meaning:
                    unanswered += 1
                    if unanswered == _SENDINGS:
                        raise DeviceLost(self._device, f"{error.what}, {_SENDINGS} times", _SILENT_CURE)
                    if meaning is Meaning.ANSWER_LOST and not repeatable:
                        raise await self._answer_lost(error, within_s)
                case Meaning.BUSY if self._clock.now_ns() < give_up_ns:
                    self.busy += 1
                    await self._clock.sleep(_ASK_AGAIN_S)
                case Meaning.ASLEEP if not self._waking:
                    await self._wake()
                case _:
                    raise error

    async def _answer_lost(self, error: DeviceError, within_s: float) -> DeviceLost:
        """Wait until the instrument is at rest: it answers in order, so the answer to a ping says so."""
        await self._asked(lambda geocom: geocom.com.nullprocess(), within_s, repeatable=True)
        return AnswerLost(self._device, error.what, error.cure)

    async def _wake(self) -> None:
        self._waking = True
        try:
            self.woken += 1
            await self._switched_on()
            if self.on_wake:
                await self.on_wake()
        finally:
            self._waking = False

    async def _switched_on(self) -> None:
        """An instrument that sleeps may answer the first request with an error, or not at all."""
        give_up_ns = self._clock.now_ns() + round(_WAKE_S * 1e9)
        while True:
            try:
                await self.set(lambda geocom: geocom.com.switch_on())
                await self.ping_ns()
            except (DeviceLost, DeviceFault, DeviceRefused):
                self.line.check()
                if self._clock.now_ns() > give_up_ns:
                    raise
                await self._clock.sleep(_ASK_AGAIN_S)
            else:
                return
