"""The contact probe's interface: connect, arm, wait for the contact, disarm."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import partial
from statistics import median
from typing import Final, final

from cellctl.clock import Clock
from cellctl.devices import (
    CommissioningStep,
    Contact,
    ContactProbe,
    DeviceError,
    DeviceFault,
    DeviceLost,
    DeviceRefused,
    DeviceUnreachable,
    Figure,
    Health,
    Identity,
    Person,
    ProbeNotOpen,
)
from drivers.contact_probe.lines import Introduction
from drivers.contact_probe.session import Session, fault_of
from drivers.serial_port import SerialPlace

_CLOSE_BOUND_S = 2.0
"""Wall time: a simulated cell with stopped time must not keep the probe open."""

_CONDITIONS: Final = {
    "alive": "the probe sends its heartbeats",
    "open": "the probe touches nothing: its loop is open and not broken",
    "whole": "the probe's loop is open or closed, not broken",
}


@final
class SerialProbe:
    """A ContactProbe with Conditions, on a serial line; its protocol: docs/reference/probe-protocol.md."""

    def __init__(self, name: str, place: SerialPlace, clock: Clock) -> None:
        self.name = name
        self._place, self._clock = place, clock
        self._session: Session | None = None

    async def connect(self) -> Identity:
        """Open the port, ask for the identity, and fit its count to the cell's clock (about 1 s of heartbeats)."""
        await self.close()
        session = self._session = Session(self.name, self._place, self._clock)
        try:
            return self._identity(await session.meet())
        except BaseException as error:
            await self._let_go()
            if isinstance(error, DeviceLost):
                raise DeviceUnreachable(self.name, error.what, error.cure) from error
            raise

    async def arm(self, on_edge: Callable[[], None], on_alive: Callable[[int], None]) -> None:
        """Arm; the probe itself verifies that the loop is open. If it is not idle, disarm and repeat."""
        session = self._connected()
        session.check()
        await session.settled()
        search = session.begin_search(on_edge, on_alive)
        try:
            await self._armed(session)
        except BaseException:
            session.end_search()
            raise
        search.armed()
        session.watch(search)

    async def contact(self) -> Contact:
        """Wait for the contact. `confirmed`: whether the level held, None if not reported within 0.5 s."""
        search = self._session.search if self._session else None
        if search is None:
            raise DeviceRefused(self.name, "is not armed, so no contact can come", "arm it first")
        return await search.outcome()

    async def touching(self) -> bool:
        """Whether the loop is closed, by the next heartbeat that the probe sends."""
        session = self._connected()
        beat = await session.beat_from_now()
        if session.search and session.search.trouble:
            raise session.search.trouble
        if beat.state == "FAULT" or not (beat.closed or beat.open):
            what = f"is at fault (loop at {beat.loop_mv} mV)"
            raise DeviceFault(self.name, what, "look at the torch lead, the earth lead and the tip")
        return beat.closed

    async def disarm(self) -> None:
        """Disarm. A probe with a persisting fault stays in FAULT, which is equally safe."""
        session = self._connected()
        if await session.command("DISARM") == "UNKNOWN":
            raise DeviceRefused(self.name, "does not know DISARM", "load firmware that speaks protocol version 1")
        session.end_search()

    async def health(self) -> Health:
        """The state and the loop, from the last heartbeat; the round trip, measured now; counts since connecting."""
        session = self._connected()
        session.check()
        round_trip_ns = await session.round_trip_ns()
        beat = session.last_beat
        if beat is None:
            raise DeviceLost(self.name, "sends no heartbeats", "check the probe's firmware")
        figures = {"loop_mV": beat.loop_mv, "latency_ms": round_trip_ns * 1e-6, **_figures(session)}
        return Health(beat.state != "FAULT", f"{beat.state}, loop at {beat.loop_mv} mV", figures)

    def commissioning(self) -> tuple[CommissioningStep, ...]:
        """Trips by hand."""
        return _steps_of(self, self._clock)

    def conditions(self) -> Mapping[str, str]:
        """The conditions that an interlock can name."""
        return _CONDITIONS

    async def holds(self, condition: str) -> bool:
        """Whether a condition holds, by the last heartbeat. Raises DeviceLost if the probe is silent, KeyError."""
        if condition not in _CONDITIONS:
            raise KeyError(condition)
        session = self._connected()
        session.check()
        beat = session.last_beat
        if condition == "alive":
            return True
        return beat is not None and (beat.open or (condition == "whole" and beat.closed))

    async def stop(self) -> None:
        """Disarm. A probe that does not answer enters its safe state by itself, since it receives nothing."""
        if self._session:
            with suppress(DeviceLost):
                await self.disarm()

    async def close(self) -> None:
        """Disarm, end the port's thread and close the port."""
        if self._session:
            with suppress(DeviceError, TimeoutError):
                async with asyncio.timeout(_CLOSE_BOUND_S):
                    await self.disarm()
        await self._let_go()

    async def _armed(self, session: Session) -> None:
        code = await session.command("ARM")
        if code == "STATE":  # tripped, or in a fault, since an earlier search
            self._judge(await session.command("DISARM"))
            code = await session.command("ARM")
        self._judge(code)

    def _judge(self, code: str) -> None:
        match code:
            case "OK":
                return
            case "CLOSED":
                cure = "move the tip clear of what it touches; if it touches nothing, free and clean it"
                raise ProbeNotOpen(self.name, "the loop is closed, so it cannot be armed", cure)
            case "WIRE":
                raise fault_of(self.name, code)
            case "STATE":
                cure = "its fault is still there; its health says what the loop is like"
                raise DeviceFault(self.name, "stays in FAULT after DISARM", cure)
            case _:
                raise DeviceFault(self.name, f"cannot be armed (answer '{code}')", "check the probe's firmware")

    def _identity(self, introduction: Introduction) -> Identity:
        simulated = any(text.upper().startswith("SIM") for text in (introduction.serial, introduction.name))
        return Identity(self.name, introduction.serial, introduction.name, introduction.firmware, simulated)

    def _connected(self) -> Session:
        if self._session is None:
            raise DeviceLost(self.name, "is not connected", "connect it first")
        self._session.link.check()
        return self._session

    async def _let_go(self) -> None:
        session, self._session = self._session, None
        if session:
            await session.close()


def _figures(session: Session) -> dict[str, float]:
    counts, ticks = session.link.counts, session.ticks
    figures: dict[str, float] = {
        "heartbeat_age_ms": session.link.silent_ns() * 1e-6,
        "lines": counts.lines,
        "crc_errors": counts.crc_errors,
        "doubles": counts.doubles,
        "old_lines": counts.old_lines,
        "refused_edges": session.refused_edges,
        "resends": counts.resends,
        "resets": session.resets,
    }
    if ticks:
        fit = ticks.fit
        figures |= {"clock_offset_ms": fit.offset_ns * 1e-6, "clock_drift_ppm": fit.drift * 1e6}
        figures |= {"clock_sigma_ms": ticks.sigma_ns() * 1e-6, "fit_sigma_ms": fit.sigma_ns * 1e-6}
        figures["hidden_delay_ms"] = ticks.hidden_ns * 1e-6
    return figures


_TRIPS = 3
_WAIT_S = 60.0
"""Longest wait for a trip, and for the loop to open again, in the cell's time."""
_LOOK_S = 0.05

_DELAY_MS = 20.0
"""Latest that an edge may be known here: the robot goes on by 0.2 mm in it at 10 mm/s. The latency timer of common
adapters is 16 ms."""
_SIGMA_US = 1000.0
"""Largest 1 σ of the contact's time: 10 µm at 10 mm/s."""


def _steps_of(probe: ContactProbe, clock: Clock) -> tuple[CommissioningStep, ...]:
    """The step of `probe`, without motion."""
    return (
        CommissioningStep(
            "trip",
            f"{_TRIPS} trips by hand",
            "The probe is armed. Somebody closes its loop by hand: a wire from the sphere's stand to the tip.",
            "a contact is seen at once, and its time is known",
            partial(_trips, probe, clock),
        ),
    )


async def _trips(probe: ContactProbe, clock: Clock, person: Person) -> list[Figure]:
    open_mv = (await probe.health()).figures.get("loop_mV")
    found = [await _trip(probe, clock, person, number) for number in range(1, _TRIPS + 1)]
    contacts = [contact for contact, _ in found]
    delays_ms = [(known_ns - contact.time_ns) * 1e-6 for contact, known_ns in found]
    held = all(contact.confirmed for contact in contacts)
    return [
        Figure("open_mV", "the loop before", open_mv, "mV"),
        Figure("confirmed", "contacts held", "yes" if held else "no", wanted="yes"),
        Figure("bounces", "further edges of a contact", max(contact.bounces for contact in contacts)),
        Figure("edge_ms", "from the edge until it is known here, median", median(delays_ms), "ms"),
        Figure("edge_most_ms", "the same, longest", max(delays_ms), "ms", most=_DELAY_MS),
        Figure("sigma_us", "1 σ of a contact's time", max(c.sigma_ns for c in contacts) * 1e-3, "µs", most=_SIGMA_US),
    ]


async def _trip(probe: ContactProbe, clock: Clock, person: Person, number: int) -> tuple[Contact, int]:
    """The contact, and when its edge was known here, ns of the cell's time. Raises DeviceFault without one."""
    known: list[int] = []
    await probe.arm(lambda: known.append(clock.now_ns()), lambda time_ns: None)
    try:
        await person.told(f"Touch the tip with the wire, and let go ({number} of {_TRIPS})", probe.name, "touch")
        async with clock.timeout(_WAIT_S):
            contact = await probe.contact()
            while await probe.touching():
                await clock.sleep(_LOOK_S)
            await clock.sleep(_LOOK_S)  # the probe arms only where the loop has been open for 20 ms
    except TimeoutError:
        what = f"no contact that began and ended came within {_WAIT_S:g} s"
        raise DeviceFault(
            probe.name, what, "check torch lead, earth lead and tip; then touch it with the wire"
        ) from None
    finally:
        await probe.disarm()
    return contact, known[0]
