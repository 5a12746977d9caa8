"""One armed search: its end conditions, the immediate callbacks, and its outcome."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import final

from cellctl.clock import Clock, Timer
from cellctl.devices import Contact, DeviceError, DeviceFault, DeviceRefused
from drivers.contact_probe.lines import Line
from drivers.contact_probe.messages import Boot, Confirmation, Edge, Fault, Heartbeat
from drivers.contact_probe.ticks import TickClock

_CONFIRM_WITHIN_S = 0.5
_EDGE_WITHIN_S = 0.5
"""Time limit for EDGE after a heartbeat that implies a contact: the probe repeats EDGE every 50 ms."""
_FAULTS = {
    "WIRE": ("the loop is broken", "check the torch lead, the earth lead and the end-of-line resistor"),
    "STUCK": ("the loop has been closed for over 10 s", "free the tip and clean spatter off it"),
    "RANGE": ("the loop's voltage is neither open nor closed", "check the earth lead and the end-of-line resistor"),
    "HOST": ("the probe heard nothing from this host for 500 ms", "check the cable; is this computer overloaded?"),
}
_RESET_CURE = "check the probe's supply and leads, then search again"


def fault_of(device: str, code: str) -> DeviceFault:
    """A fault code of the probe (`WIRE`) as text, with its cure."""
    what, cure = _FAULTS.get(code, ("the probe is at fault", "see the probe's manual"))
    return DeviceFault(device, f"{what} (fault {code})", cure)


def _missed(device: str, beat: Heartbeat) -> DeviceFault:
    """The line that an armed probe failed to send, from its heartbeat."""
    if beat.state == "TRIPPED":
        what = f"tripped without saying when: no EDGE within {_EDGE_WITHIN_S:g} s"
        return DeviceFault(device, what, "look at the serial line: its health counts spoilt and old lines")
    if beat.closed:
        what = f"is armed with its loop closed ({beat.loop_mv} mV): it missed the edge"
        return DeviceFault(
            device, what, "check the probe's edge capture: its A/D input sees the contact, that does not"
        )
    what = f"is armed with its loop at {beat.loop_mv} mV, neither open nor closed, and reports no fault"
    return DeviceFault(device, what, "check the torch lead, the earth lead and the end-of-line resistor")


@final
class Search:
    """From arming to disarming; `ticks` is settled, `earlier_edges` are the ticks of those received before.

    `alive`, `at_once` and `halt` may be called from any thread; the rest belongs to the loop.
    """

    def __init__(
        self,
        device: str,
        clock: Clock,
        ticks: TickClock,
        on_edge: Callable[[], None],
        on_alive: Callable[[int], None],
        earlier_edges: frozenset[int],
    ) -> None:
        self.alive = on_alive
        self._earlier_edges = earlier_edges
        self._device, self._clock, self._ticks, self._on_edge = device, clock, ticks, on_edge
        self._begin_tick = ticks.last_tick
        self._armed = False
        self._halted = False
        self._edge_came = False
        self._due: Timer | None = None  # the outcome if there is no better one
        self._outcome: Contact | DeviceError | None = None
        self._ended = asyncio.Event()

    @property
    def ended(self) -> bool:
        """Whether the outcome is known."""
        return self._ended.is_set()

    @property
    def trouble(self) -> DeviceError | None:
        """The error that ended the search instead of a contact, so far."""
        return self._outcome if isinstance(self._outcome, DeviceError) else None

    def armed(self) -> None:
        """The probe reported that it is armed: from now on a heartbeat in another state ends the search."""
        self._armed = True

    def at_once(self, line: Line) -> None:
        """Halt if `line` ends the search: an edge, a reset, a fault, or one of these that the probe missed."""
        match line.message:
            case Edge(edge_tick=tick) | Confirmation(edge_tick=tick):
                over = tick not in self._earlier_edges
            case Heartbeat() as beat:
                over = self._armed and (beat.state != "ARMED" or not beat.open)
            case message:
                over = isinstance(message, Boot | Fault)
        if over:
            self.halt()

    def halt(self) -> None:
        """Report, once, that the search is over."""
        if not self._halted:
            self._halted = True
            self._on_edge()

    def pursue(self, line: Line, *, new: bool) -> bool:
        """Evaluate `line`: a contact, a fault, or neither yet. Returns whether it contained a refused edge.

        `new`: the line is newer than all before it, as `Arrival.new`.
        """
        match line.message:
            case Edge(edge_tick=tick) | Confirmation(edge_tick=tick) if tick not in self._earlier_edges:
                if untrue := self._why_untrue(tick, line, new=new):
                    self._refuse(line, untrue)
                else:
                    self._pursue_edge(line.message)
                return bool(untrue)
            case Boot(cause=cause):
                what = f"was reset while armed (cause {cause}); the search is void"
                self.end(DeviceFault(self._device, what, _RESET_CURE))
            case Fault(code=code):
                self.end(fault_of(self._device, code))
            case Heartbeat() as beat if self._armed:
                self._pursue_beat(beat)
        return False

    def end(self, outcome: Contact | DeviceError) -> None:
        """Set the outcome; the first one counts."""
        self.halt()
        if self._outcome is None:
            self._outcome = outcome
            self._ended.set()

    def close(self) -> None:
        """Disarmed: no more lines are expected, and a caller that waits for a contact is woken."""
        if self._due:
            self._due.cancel()
        self._halted = True
        self.end(DeviceRefused(self._device, "was disarmed before a contact", "arm it, then wait for the contact"))

    async def outcome(self) -> Contact:
        """Wait for the contact. Raises the error if one ended the search."""
        await self._ended.wait()
        assert self._outcome is not None
        if isinstance(self._outcome, DeviceError):
            raise self._outcome
        return self._outcome

    def _pursue_edge(self, message: Edge | Confirmation) -> None:
        tick = message.edge_tick
        if isinstance(message, Confirmation):
            self._contact(tick, confirmed=message.confirmed == 1, bounces=message.bounces)
        elif not self._edge_came:
            self._edge_came = True
            self._conclude_in(_CONFIRM_WITHIN_S, lambda: self._contact(tick, confirmed=None, bounces=0))

    def _pursue_beat(self, beat: Heartbeat) -> None:
        if beat.state not in {"ARMED", "TRIPPED"}:
            what = f"went to {beat.state} while armed (loop at {beat.loop_mv} mV)"
            self.end(DeviceFault(self._device, what, _RESET_CURE))
        elif (beat.state == "TRIPPED" or not beat.open) and self._due is None:
            fault = _missed(self._device, beat)
            self._conclude_in(_EDGE_WITHIN_S, lambda: self.end(fault))

    def _refuse(self, line: Line, untrue: str) -> None:
        what = f"reported an edge {untrue}: {line.message} in a line of tick {line.tick}"
        self.end(DeviceFault(self._device, what, "check the probe's firmware and its timer, then search again"))

    def _conclude_in(self, seconds: float, conclude: Callable[[], None]) -> None:
        if self._due:
            self._due.cancel()
        self._due = self._clock.call_later(seconds, conclude)

    def _contact(self, tick: int, *, confirmed: bool | None, bounces: int) -> None:
        self.end(Contact(self._ticks.cell_ns(tick), self._ticks.sigma_ns(), tick, confirmed, bounces))

    def _why_untrue(self, edge_tick: int, line: Line, *, new: bool) -> str:
        """Why it cannot be the time of this search's contact; empty if it can.

        Later than the start of its own line, or in a line whose count has jumped ahead or has stopped; or before
        arming: an edge of an earlier search was received then, or nobody knows what the probe reports.
        """
        jumped = not new and not self._ticks.is_before(line.tick, self._ticks.last_tick)
        if jumped or self._ticks.is_before(line.tick, edge_tick):
            return "in the future"
        return "from before it was armed" if self._ticks.is_before(edge_tick, self._begin_tick) else ""
