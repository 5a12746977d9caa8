"""Allows one command at a time, and holds the robot unless the controller itself reports the end of a motion."""

from __future__ import annotations

from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager, suppress
from typing import final

from cellctl.clock import Clock
from cellctl.devices import DeviceError, DeviceFault, DeviceLost, DeviceRefused, DeviceUncertain, LimitExceeded
from drivers.kuka_rsi.cyclic.shared_block import Slot
from drivers.kuka_rsi.robot.lines import ControllerLines
from drivers.seen_through import see_through

_HALT_S = 8.0
"""Less than the engine waits for a stop (10 s): it would give up first, and the words of `_uncertain` were lost."""

_STANDS = (0, 30, 31)
"""Codes of HALT's reply that confirm a standstill: done, stopped by another HALT, held by a message. A refusal (10
busy, 11 unreadable, 12 not ready) comes while the robot may still move."""

_LOOK_S = 0.02
"""Cell time between two looks whether a command has ended."""


@final
class Holding:
    """The command in progress, and how it is stopped.

    `search`: number of the search in progress, else of the next. `correcting`: RSI is on beside the program's motions.
    """

    def __init__(self, device: str, lines: ControllerLines) -> None:
        self.search = 1
        self.correcting = False
        self._device = device
        self._lines = lines
        self._busy = False
        self._stop = False
        self._adrift = False  # a motion was interrupted, and standstill is not confirmed since

    def stop_now(self) -> None:
        """Stop this search and every later one, until `clear_stop`; safe from any thread, never blocks."""
        self._put_stop(stop=True)

    def clear_stop(self) -> None:
        """Clear the stop."""
        self._put_stop(stop=False)

    def keep_stop(self) -> None:
        """A stop that was set before there was an RSI process, or with an earlier one, holds in this one too."""
        if self._stop and (block := self._lines.block):
            block.words[Slot.STOP] = 1

    async def stop(self) -> None:
        """Hold the robot in any state. Raises DeviceUncertain if the controller does not confirm it."""
        self.stop_now()
        if not self._stands() and not await see_through(self._halt()):
            raise self._uncertain()

    async def until_free(self, clock: Clock) -> None:
        """Wait for the end of the command in progress, if there is one; its own time limit bounds it."""
        while self._busy:
            await clock.sleep(_LOOK_S)

    @contextmanager
    def one_at_a_time(self) -> Iterator[None]:
        """A command is in progress. Raises DeviceRefused if another one is."""
        if self._busy:
            raise DeviceRefused(self._device, "another command is under way")
        self._busy = True
        try:
            yield
        finally:
            self._busy = False

    @asynccontextmanager
    async def held_in_trouble(self) -> AsyncIterator[None]:
        """One motion at a time; halts the robot unless the controller itself reports the end of the motion.

        Nothing is begun while an earlier stop is not confirmed: it is asked for again. Raises DeviceUncertain.
        """
        with self.one_at_a_time():
            if self._adrift and not await see_through(self._halt()):
                raise self._uncertain("it was not confirmed before either; nothing was begun")
            try:
                yield
            except (DeviceRefused, DeviceFault, LimitExceeded):
                raise
            except BaseException as error:
                self.stop_now()
                if not await see_through(self._halt()) and isinstance(error, Exception):
                    raise self._uncertain(error.what if isinstance(error, DeviceError) else str(error)) from error
                raise  # a cancellation: whoever cancelled stops the robot, and is told

    def _uncertain(self, cause: str = "") -> DeviceUncertain:
        what = "the controller has not confirmed that the robot stands: it may still be moving"
        return DeviceUncertain(
            self._device,
            f"{what} ({cause})" if cause else what,
            "Keep away from it, stop it at the pendant, then look at the EthernetKRL line.",
        )

    def _put_stop(self, *, stop: bool) -> None:
        self._stop = stop  # before the block is looked at: one that appears meanwhile gets it by `keep_stop`
        if block := self._lines.block:
            block.words[Slot.STOP] = int(stop)

    async def _halt(self) -> bool:
        """Request standstill and wait for it; returns whether the controller confirmed it.

        The search is released only once RSI is known to be off: until then the robot is held in place.
        """
        if self._lines.connected:
            self._adrift = True
            with suppress(DeviceError):
                process, eki = self._lines.process, self._lines.halting
                reply = await eki.ask("HALT", timeout_s=_HALT_S)
                if reply.code in _STANDS:
                    process.block.release()
                    self.leave_correction()
                    self._adrift = False
        return not self._adrift

    def leave_correction(self) -> None:
        """RSI is off again. Its number is not used again: the process would take the next search for a correction.

        A stop that is set stays set for the next search.
        """
        self.search += self.correcting
        self.correcting = False

    def _stands(self) -> bool:
        """Whether the controller reports standstill; false if it is lost."""
        if not self._lines.connected:
            return True
        # A message (ERROR) does not count as a motion: a command of ours is `_busy` until its reply, and if a message
        # stopped it, the reply comes when the robot stands.
        with suppress(DeviceLost):
            return not (
                self._busy or self._adrift or self.correcting or self._lines.halting.stat.program in ("MOVING", "RSI")
            )
        return False
