"""What the simulated probe is to the rest: its scheme, settings, faults and events."""

from __future__ import annotations

from sims.probe._lines import ARM, CONTACT, baud_of
from sims.simulator import FOR_MS, FaultKind, Setting, Setup, Simulator, Started


def _start(setup: Setup) -> Started:
    from sims.probe._server import ProbeServer  # when a cell has the device

    return ProbeServer(setup)


def _address_errors(address: str) -> list[str]:
    try:
        possible = baud_of(address) > 0
    except ValueError:
        possible = False
    return [] if possible else ["baud is not a number above 0"]


SIMULATOR = Simulator(
    schemes=("contact+serial",),
    start=_start,
    section="probe",
    settings=(
        Setting(
            "usb_delay_ms",
            "number",
            1.0,
            0.0,
            what="Grid of the adapter's polls; 0: none.",
            measured="connection.latency_spread_ms",
        ),
        Setting(
            "bounce",
            "whole",
            2,
            step=2,
            what="Further edges of a contact: it opens and closes again.",
            measured="trip.bounces",
        ),
    ),
    faults=(
        FaultKind("probe.closed", "the loop is closed", (FOR_MS,)),
        FaultKind("probe.wire_break", "the loop is broken", (FOR_MS,)),
        FaultKind("probe.silent", "nothing comes from the probe any more", (FOR_MS,)),
        FaultKind("probe.reset", "watchdog reset", momentary=True),
        FaultKind("probe.no_contact", "the tip never closes the loop (spatter, broken tip)", (FOR_MS,)),
        FaultKind(
            "probe.corrupt",
            "a character of every n-th line is wrong",
            (Setting("every", "whole", 1, 1, what="Each how many lines one is wrong."), FOR_MS),
        ),
    ),
    events={ARM: "the probe is armed", CONTACT: "it trips: the loop has closed while it was armed"},
    address_errors=_address_errors,
)
