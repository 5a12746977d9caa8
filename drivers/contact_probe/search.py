"""One armed search: what ends it, whom that concerns at once, and what comes out."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import final

from cellctl.clock import Clock, Timer
from cellctl.devices import Contact, DeviceError, DeviceFault, DeviceRefused
from drivers.contact_probe.messages import Boot, Confirmation, Edge, Fault, Heartbeat, Message
from drivers.contact_probe.ticks import TickClock

_CONFIRM_WITHIN_S = 0.5
_FAULTS = {
    "WIRE": ("the loop is broken", "check the torch lead, the earth lead and the end-of-line resistor"),
    "STUCK": ("the loop has been closed for over 10 s", "free the tip and clean spatter off it"),
    "RANGE": ("the loop's voltage is neither open nor closed", "check the earth lead and the end-of-line resistor"),
    "HOST": ("the probe heard nothing from this host for 500 ms", "check the cable; is this computer overloaded?"),
}
_RESET_CURE = "check the probe's supply and leads, then search again"


def fault_of(device: str, code: str) -> DeviceFault:
    """A fault code of the probe (`WIRE`) in words, with its cure."""
    what, cure = _FAULTS.get(code, ("the probe is at fault", "see the probe's manual"))
    return DeviceFault(device, f"{what} (fault {code})", cure)


@final
class Search:
    """From arming to disarming; `ticks` is settled.

    `alive`, `at_once` and `halt` may be called from any thread; the rest belongs to the loop.
    """

    def __init__(
        self,
        device: str,
        clock: Clock,
        ticks: TickClock,
        on_edge: Callable[[], None],
        on_alive: Callable[[int], None],
    ) -> None:
        self.alive = on_alive
        self._device, self._clock, self._ticks, self._on_edge = device, clock, ticks, on_edge
        self._begin_tick = ticks.last_tick
        self._armed = False
        self._halted = False
        self._confirmation_due: Timer | None = None
        self._outcome: Contact | DeviceError | None = None
        self._ended = asyncio.Event()

    @property
    def ended(self) -> bool:
        """Whether the outcome is known."""
        return self._ended.is_set()

    @property
    def trouble(self) -> DeviceError | None:
        """What ended the search instead of a contact, so far."""
        return self._outcome if isinstance(self._outcome, DeviceError) else None

    def armed(self) -> None:
        """The probe said that it is armed: from here on a heartbeat that says otherwise ends the search."""
        self._armed = True

    def at_once(self, message: Message) -> None:
        """Halt where `message` ends the search: the edge, what only follows on an edge, a reset, a fault."""
        match message:
            case Edge(edge_tick=tick) | Confirmation(edge_tick=tick):
                over = self._is_ours(tick)
            case Heartbeat(state=state):
                over = self._armed and state != "ARMED"
            case _:
                over = isinstance(message, Boot | Fault)
        if over:
            self.halt()

    def halt(self) -> None:
        """Say, once, that the search is over."""
        if not self._halted:
            self._halted = True
            self._on_edge()

    def pursue(self, message: Message) -> None:
        """Draw the conclusions from `message`: a contact, a fault, or none yet."""
        match message:
            case Edge(edge_tick=tick) if self._is_ours(tick) and not self._confirmation_due:
                self._confirmation_due = self._clock.call_later(
                    _CONFIRM_WITHIN_S, lambda: self._contact(tick, confirmed=None, bounces=0)
                )
            case Confirmation(edge_tick=tick, confirmed=confirmed, bounces=bounces) if self._is_ours(tick):
                self._contact(tick, confirmed=confirmed == 1, bounces=bounces)
            case Boot(cause=cause):
                what = f"was reset while armed (cause {cause}); the search is void"
                self.end(DeviceFault(self._device, what, _RESET_CURE))
            case Fault(code=code):
                self.end(fault_of(self._device, code))
            case Heartbeat(state="DISARMED" | "FAULT" as state, loop_mv=loop_mv) if self._armed:
                what = f"went to {state} while armed (loop at {loop_mv} mV)"
                self.end(DeviceFault(self._device, what, _RESET_CURE))

    def end(self, outcome: Contact | DeviceError) -> None:
        """Set the outcome; the first one counts."""
        self.halt()
        if self._outcome is None:
            self._outcome = outcome
            self._ended.set()

    def close(self) -> None:
        """Disarmed: nothing more comes, and who still waits for a contact learns so."""
        if self._confirmation_due:
            self._confirmation_due.cancel()
        self._halted = True
        self.end(DeviceRefused(self._device, "was disarmed before a contact", "arm it, then wait for the contact"))

    async def outcome(self) -> Contact:
        """Wait for the contact. Raises what else ended the search."""
        await self._ended.wait()
        assert self._outcome is not None
        if isinstance(self._outcome, DeviceError):
            raise self._outcome
        return self._outcome

    def _contact(self, tick: int, *, confirmed: bool | None, bounces: int) -> None:
        self.end(Contact(self._ticks.cell_ns(tick), self._ticks.sigma_ns(), tick, confirmed, bounces))

    def _is_ours(self, edge_tick: int) -> bool:
        """Not the edge of an earlier search, sent again because its acknowledgement was lost."""
        return not self._ticks.is_before(edge_tick, self._begin_tick)
