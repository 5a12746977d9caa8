"""The commissioning of a contact probe: trips by hand."""

from __future__ import annotations

from functools import partial
from statistics import median

from cellctl.clock import Clock
from cellctl.devices import CommissioningStep, Contact, ContactProbe, DeviceFault, Figure, Person

_TRIPS = 3
_WAIT_S = 60.0
"""Longest wait for a trip, and for the loop to open again, in the cell's time."""
_LOOK_S = 0.05

_DELAY_MS = 20.0
"""Latest that an edge may be known here: the robot goes on by 0.2 mm in it at 10 mm/s. The latency timer of common
adapters is 16 ms."""
_SIGMA_US = 1000.0
"""Largest 1 σ of the contact's time: 10 µm at 10 mm/s."""


def steps_of(probe: ContactProbe, clock: Clock) -> tuple[CommissioningStep, ...]:
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
    except TimeoutError:
        what = f"no contact that began and ended came within {_WAIT_S:g} s"
        raise DeviceFault(
            probe.name, what, "check torch lead, earth lead and tip; then touch it with the wire"
        ) from None
    finally:
        await probe.disarm()
    return contact, known[0]
