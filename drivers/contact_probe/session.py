"""One connection to a probe, from opening its port to closing it, and the armed search within it."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from contextlib import suppress
from typing import Final, final

from cellctl.clock import Clock, Timer
from cellctl.devices import Contact, DeviceError, DeviceFault, DeviceLost, DeviceRefused, DeviceUnreachable
from drivers.contact_probe.lines import Boot, Confirmation, Edge, Fault, Heartbeat, Introduction, Line, Reply, Synced
from drivers.contact_probe.link import Answered, Arrival, Link
from drivers.contact_probe.ticks import TickClock
from drivers.serial_port import SerialPlace, open_port

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

PROTOCOL = 1
_QUIET_S = 0.1
"""Delay before the first command: opening the port resets many boards."""
_PATIENCE_S = 5.0
_SETTLED_S = 1.0
"""Least span of the lines for a valid fit of the count to the cell's clock."""
_SYNC_EVERY_S = 0.2
_SILENCE_S = 0.17
"""Three missed heartbeats of 50 ms, and 20 ms of transmission."""
_OLD_CURE = "restart the probe, then connect anew; does a bridge or hub hold lines back, is tick_hz right to 300 ppm?"


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


@final
class Session:
    """A connection; `search` is the armed search, if there is one.

    Raises DeviceUnreachable if the port cannot be opened.
    """

    def __init__(self, device: str, place: SerialPlace, clock: Clock) -> None:
        self.search: Search | None = None
        self.ticks: TickClock | None = None
        self.last_beat: Heartbeat | None = None
        self._beat_tick = 0
        self._beaten = asyncio.Event()
        self.resets = self.refused_edges = 0
        self._edges: set[int] = set()
        self._device, self._place, self._clock = device, str(place), clock
        self.link: Final = Link(device, open_port(device, place), place.baud, clock, self)
        self.link.start()

    async def meet(self) -> Introduction:
        """Ask for the identity, and fit its count to the cell's clock. Raises DeviceUnreachable, DeviceLost."""
        await self._clock.sleep(_QUIET_S)
        try:
            async with self._clock.timeout(_PATIENCE_S):
                introduction = await self._introduction()
        except TimeoutError:
            raise self._unanswered() from None
        if introduction.proto != PROTOCOL:
            cure = f"load firmware that speaks protocol version {PROTOCOL}"
            raise DeviceUnreachable(self._device, f"speaks protocol version {introduction.proto}", cure)
        if introduction.tick_hz == 0:
            raise DeviceUnreachable(self._device, "reports a clock rate of 0 (tick_hz 0)", "check its firmware")
        self.ticks = TickClock(introduction.tick_hz)
        await self.settled()
        self.resets = 0  # the reset from opening the port does not count
        return introduction

    async def settled(self) -> TickClock:
        """The probe's count, once its fit covers a second of lines. Raises DeviceLost after 5 s without it."""
        if self.ticks is None:
            raise DeviceLost(self._device, "did not report its clock rate", "connect it first")
        try:
            async with self._clock.timeout(_PATIENCE_S):
                while self.ticks.span_s < _SETTLED_S:
                    await self.round_trip_ns()
                    await self._clock.sleep(_SYNC_EVERY_S)
        except TimeoutError:
            what = f"counted less than {_SETTLED_S:g} s within {_PATIENCE_S:g} s ({self.resets} resets)"
            raise DeviceLost(
                self._device, what, "check the probe's supply, and that its clock runs at tick_hz"
            ) from None
        return self.ticks

    async def round_trip_ns(self) -> int:
        """Time from sending a SYNC to its answer; it also bounds the adapter's delay. Raises DeviceLost."""
        answered = await self._ask("SYNC")
        if self.ticks and isinstance(answered.message, Synced):
            self.ticks.add_sync(answered.message.received_tick, answered.sent_ns + answered.wire_ns)
        return answered.arrival.time_ns - answered.sent_ns

    async def command(self, kind: str) -> str:
        """The code that answers ARM or DISARM. Raises DeviceLost."""
        answered = await self._ask(kind)
        return answered.message.code if isinstance(answered.message, Reply) else ""

    async def beat_from_now(self) -> Heartbeat:
        """The first heartbeat that the probe begins to send after this call. Raises DeviceLost."""
        ticks, now_ns = await self.settled(), self._clock.now_ns()
        try:
            async with self._clock.timeout(_SILENCE_S):
                while self.last_beat is None or ticks.cell_ns(self._beat_tick) < now_ns:
                    self._beaten.clear()
                    await self._beaten.wait()
        except TimeoutError:
            self.check()
            raise DeviceLost(self._device, "sends no heartbeats", "check the probe's firmware") from None
        return self.last_beat

    def check(self) -> None:
        """Raises DeviceLost if the port was lost or the heartbeats have stopped."""
        self.link.check()
        silent_s = self.link.silent_ns() * 1e-9
        if silent_s > _SILENCE_S:
            if reason := self.link.why_not_alive():
                what = f"has sent nothing new for {silent_s * 1e3:.0f} ms ({reason})"
                raise DeviceLost(self._device, what, _OLD_CURE)
            what = f"has been silent for {silent_s * 1e3:.0f} ms"
            raise DeviceLost(self._device, what, "check the line and the probe's supply")

    def watch(self, search: Search) -> None:
        """End `search` when the probe falls silent; in the cell's time, which may be stopped."""
        if search.ended:
            return
        try:
            self.check()
        except DeviceLost as loss:
            search.end(loss)
            return
        left_s = _SILENCE_S - self.link.silent_ns() * 1e-9
        self._clock.call_later(max(left_s, 0.001), lambda: self.watch(search))

    def begin_search(self, on_edge: Callable[[], None], on_alive: Callable[[int], None]) -> Search:
        """To be armed next: it ends by any edge that was not received before. The count is settled."""
        self.end_search()
        assert self.ticks
        self.search = Search(self._device, self._clock, self.ticks, on_edge, on_alive, frozenset(self._edges))
        return self.search

    def end_search(self) -> None:
        """Disarmed: discard the search."""
        if self.search:
            self.search.close()
        self.search = None

    async def close(self) -> None:
        """End the port's thread, close the port, end the search."""
        await self.link.close()
        self.end_search()

    # Callbacks of the link. `alive`, `at_once` and `gone_at_once` are called by the port's thread.

    def alive(self, time_ns: int) -> None:
        """Pass a sign of life on."""
        if search := self.search:
            search.alive(time_ns)

    def at_once(self, line: Line) -> None:
        """Halt the search before the line that ends it is acknowledged."""
        if search := self.search:
            search.at_once(line)
        if isinstance(line.message, Boot):
            self._edges.clear()
        if isinstance(line.message, Edge | Confirmation):
            self._edges.add(line.message.edge_tick)

    def gone_at_once(self) -> None:
        """Halt the search: the tip is no longer monitored."""
        if search := self.search:
            search.halt()

    def gone(self, loss: DeviceLost) -> None:
        """End the search."""
        if self.search:
            self.search.end(loss)

    def arrived(self, arrival: Arrival) -> None:
        """Update the fit, store the line, and evaluate it for the search."""
        line = arrival.line
        if isinstance(line.message, Boot):
            self.resets += 1
            if self.ticks:
                self.ticks.restart()
        if isinstance(line.message, Heartbeat) and arrival.new:
            self.last_beat, self._beat_tick = line.message, line.tick
            self._beaten.set()
        if self.ticks and arrival.new:
            self.ticks.add_line(line.tick, arrival.time_ns, arrival.wire_ns)
        if self.search:
            self.refused_edges += self.search.pursue(line, new=arrival.new)

    async def _introduction(self) -> Introduction:
        while True:
            with suppress(TimeoutError):  # a board that was reset by opening its port answers after a second or two
                message = (await self.link.ask("HELLO")).message
                if isinstance(message, Introduction):
                    return message

    async def _ask(self, kind: str) -> Answered:
        with suppress(TimeoutError):
            return await self.link.ask(kind)
        self.check()
        what = f"did not answer {kind}, sent five times"
        raise DeviceLost(self._device, what, "check the line and the probe's supply")

    def _unanswered(self) -> DeviceUnreachable:
        heard = self.link.counts
        if self.link.silent_ns() * 1e-9 > _SILENCE_S and (reason := self.link.why_not_alive()):
            what, cure = f"sends nothing new: {reason}", _OLD_CURE
        elif heard.lines:
            what, cure = "is heard but does not answer", "check the line from this host to the probe"
        elif heard.crc_errors:
            what, cure = "sends nothing that can be read", "is the baud rate right, and is it a contact probe?"
        else:
            what, cure = "does not answer", "check the probe's supply, and that the address names its port"
        return DeviceUnreachable(self._device, f"{what} ({self._place}, {_PATIENCE_S:g} s)", cure)
