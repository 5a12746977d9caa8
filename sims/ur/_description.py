"""What the simulated UR controller is to the rest: its scheme, settings, faults and events."""

from __future__ import annotations

from urllib.parse import parse_qs, urlsplit

from sims.faults import MOVE
from sims.simulator import FOR_MS, FaultKind, Setting, Setup, Simulator, Started
from sims.ur._names import PROGRAM, QUERY, SPEED


def _start(setup: Setup) -> Started:
    from sims.ur._servers import start  # when a cell has the device

    return start(setup)


def _address_errors(address: str) -> list[str]:
    parts = urlsplit(address)
    if parts.path or not parts.hostname or not parse_qs(parts.query).keys() <= {*QUERY, "dashboard"}:
        return [f"this address has a host, and nothing else but {', '.join(QUERY)} and dashboard"]
    return []


SIMULATOR = Simulator(
    schemes=("ur+rtde",),
    start=_start,
    section="ur",
    settings=(
        Setting("series", "word", "e", among=("e", "cb3"), what="Controller: 500 Hz (e) or 125 Hz (cb3)."),
        Setting("power", "word", "running", among=("running", "off"), what="Of the arm when the cell starts."),
        Setting("control", "word", "remote", among=("remote", "local"), what="Who may command when the cell starts."),
        Setting("calibration_knows", "number", 0.7, 0.0, what="Share of the arm's errors in its own calibration."),
        Setting("lag_ms", "number", 4.0, 0.0, what="Of the joints at constant speed, times errors: servo."),
        Setting("probe_input", "whole", None, what="Digital input of the probe's wire, 0 to 17; without it none."),
        Setting("programs", "word", None, what="Folder whose NAME.script is the program NAME.urp."),
        Setting("program", "word", None, what="NAME.urp that is loaded and played when the cell starts."),
    ),
    faults=(
        FaultKind("ur.drop", "RTDE packages to the hosts are lost", (FOR_MS,)),
        FaultKind("ur.stall", "RTDE packages of the hosts are lost: inputs keep their values", (FOR_MS,)),
        FaultKind(
            "ur.slow",
            "what the controller sends comes in small pieces",
            (Setting("bytes", "whole", 1, 1, what="Bytes in each millisecond."), FOR_MS),
        ),
        FaultKind("ur.protective_stop", "the controller detects a collision that there is not", momentary=True),
        FaultKind("ur.stop", "the operator's stop at the pendant: the program ends", momentary=True),
        FaultKind("ur.power_off", "somebody switches the arm off at the pendant", momentary=True),
        FaultKind("ur.local", "the pendant is in local control", (FOR_MS,)),
        FaultKind("ur.reboot", "the controller restarts: connections, registers and program are lost", momentary=True),
        FaultKind("ur.second_client", "another client has taken all input registers", (FOR_MS,)),
        FaultKind("ur.wrong_serial", "another controller's serial number", (FOR_MS,)),
        FaultKind(
            "ur.clock_jump",
            "the controller's clock jumps",
            (Setting("ms", "number", 1000.0, what="By how much, forwards."),),
            momentary=True,
        ),
    ),
    events={
        MOVE: "a movej or movel begins",
        SPEED: "a speedj or speedl begins at rest",
        PROGRAM: "a program begins",
    },
    address_errors=_address_errors,
)
