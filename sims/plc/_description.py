"""What the simulated PLC is to the rest: its scheme, settings, faults and events."""

from __future__ import annotations

from sims.plc._modbus import HEARTBEAT, unit_of
from sims.simulator import FOR_MS, FaultKind, Setting, Setup, Simulator, Started


def _start(setup: Setup) -> Started:
    from sims.plc._server import PlcServer  # when a cell has the device

    return PlcServer(setup)


def _address_errors(address: str) -> list[str]:
    try:
        unit_of(address)
    except ValueError:
        return ["unit is not a number from 0 to 255"]
    return []


SIMULATOR = Simulator(
    schemes=("modbus+tcp",),
    start=_start,
    section="plc",
    settings=(
        Setting(
            "delay_least_ms",
            "number",
            5.0,
            0.0,
            what="Shortest time from a request to its answer.",
            measured="connection.latency_least_ms",
        ),
        Setting(
            "delay_most_ms",
            "number",
            20.0,
            0.0,
            what="Longest time from a request to its answer.",
            measured="connection.latency_most_ms",
        ),
        Setting("clamp_ms", "number", 300.0, 0.0, what="Time that the clamp takes from one end to the other."),
    ),
    faults=(
        FaultKind("plc.gone", "every connection is closed, and nothing answers at its port", (FOR_MS,)),
        FaultKind(
            "plc.stale", "its program stops: it answers, but its inputs and its counter do not change", (FOR_MS,)
        ),
        FaultKind(
            "plc.sensor",
            "a sensor is broken: its register shows 0x8000",
            (
                Setting("sensor", "whole", 1, 1, what="Air 1, base 2, arm 3, fixture 4, pressure 5, humidity 6."),
                FOR_MS,
            ),
        ),
        FaultKind("plc.clamp", "a sensor of the clamp is stuck: clamped and unclamped are both on", (FOR_MS,)),
    ),
    events={HEARTBEAT: "the computer has written another value to its heartbeat register"},
    address_errors=_address_errors,
)
