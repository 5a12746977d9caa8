"""What the simulated drives are to the rest: schemes, settings and faults."""

from __future__ import annotations

from sims.drives._address import SYNC, nodes_of
from sims.simulator import FOR_MS, FaultKind, Setting, Setup, Simulator, Started

_NODE = Setting("node", "whole", 1, 1, what="Its node number on the bus.")


def _start(setup: Setup) -> Started:
    from sims.drives._server import DriveServer  # when a cell has the device

    return DriveServer(setup)


def _address_errors(address: str) -> list[str]:
    try:
        nodes_of(address)
    except ValueError as error:
        return [str(error)]
    return []


SIMULATOR = Simulator(
    schemes=("canopen+socketcan", "canopen+udp-multicast"),
    start=_start,
    section="drives",
    settings=(
        Setting("brakes_after_s", "number", 10.0, 0.0, what="The brakes close so long after standstill."),
        Setting("noise", "number", 0.004, 0.0, what="1 σ of a current, as share of the rated current."),
    ),
    faults=(
        FaultKind("drives.reboot", "a drive restarts: it is in pre-operational afterwards", (_NODE,), momentary=True),
        FaultKind(
            "drives.emcy",
            "a drive reports a fault (EMCY), and switches its power off",
            (_NODE, Setting("code", "whole", 0x4310, 1, what="Error code, 0x603F; 17168 is over-temperature.")),
            momentary=True,
        ),
        FaultKind("drives.silent", "nothing comes from a drive any more", (_NODE, FOR_MS)),
    ),
    events={SYNC: "a SYNC is on the bus"},
    address_errors=_address_errors,
)
