"""What the simulated proxy and its controller are to the rest: scheme, settings, faults and events."""

from __future__ import annotations

from urllib.parse import urlsplit

from sims.simulator import FOR_MS, FaultKind, Setting, Setup, Simulator, Started
from sims.varproxy._proxy import C3, JOB, KUKAVARPROXY, ROW


def _start(setup: Setup) -> Started:
    from sims.varproxy._controller import start  # when a cell has the device

    return start(setup)


def _address_errors(address: str) -> list[str]:
    return [] if not urlsplit(address).query else ["this address has no settings"]


SIMULATOR = Simulator(
    schemes=("kuka+varproxy",),
    start=_start,
    section="varproxy",
    settings=(
        Setting("proxy", "word", C3, among=(C3, KUKAVARPROXY), what="Which server answers; only one has files."),
        Setting(
            "delay_least_ms",
            "number",
            4.0,
            0.0,
            what="Shortest time that a request takes.",
            measured="connection.latency_least_ms",
        ),
        Setting(
            "delay_most_ms",
            "number",
            12.0,
            0.0,
            what="Longest time that a request takes.",
            measured="connection.latency_most_ms",
        ),
    ),
    faults=(
        FaultKind("varproxy.gone", "every connection is closed, and nothing answers at its port", (FOR_MS,)),
        FaultKind("varproxy.cut", "the connection is lost in the middle of the next answer", momentary=True),
        FaultKind(
            "varproxy.slow",
            "each request takes longer",
            (Setting("delay_ms", "number", 8000.0, 0.0, what="Longer by so much."), FOR_MS),
        ),
        FaultKind("varproxy.wrong_id", "answers have the number of another request", (FOR_MS,)),
        FaultKind("varproxy.garbage", "bytes that are no message come in place of an answer", (FOR_MS,)),
        FaultKind("varproxy.unloaded", "the generated data list is not loaded: its variables are unknown", (FOR_MS,)),
        FaultKind("varproxy.alters", "a row of a table is stored with another last digit", (FOR_MS,)),
        FaultKind("varproxy.stop", "the operator's stop: the controller brakes and shows a message", momentary=True),
    ),
    events={JOB: "the program begins a move", ROW: "a row of a table is written"},
    address_errors=_address_errors,
)
