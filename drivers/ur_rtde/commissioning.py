"""The commissioning of a UR: its data at rest, the probe's wire, a tenth of a degree of each axis, stops."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from statistics import median, stdev
from typing import Protocol, final

from cellctl.clock import Clock, DelayFit
from cellctl.devices import CommissioningStep, DeviceFault, Figure, Person
from drivers.commissioning_motions import (
    LINE_DEG,
    LINE_DEG_S,
    STOPS,
    TENTH_DEG,
    TENTH_DEG_S,
    MovingRobot,
    stop_figures,
    stops,
    tenths,
)
from drivers.ur_rtde.state import Sample

_DATA_S = 30.0
_MISSED_SHARE = 0.01
"""Largest share of packages that are left out, or not newer than the one before."""

_SIGMA_MS = 1.0
"""Largest 1 σ of a sample's time by the fitted clock: 10 µm at 10 mm/s."""

_CURRENT_SIGMA_A = 0.1
"""Largest scatter of a joint's current at rest: currents are compared in hundredths of an ampere."""

_CONTACTS = 3
_WAIT_S = 60.0
"""Longest wait for a contact by hand, and for its end, in the cell's time."""

_LONGEST_STOP_S = 0.15
"""From the stop of this computer to standstill: a package each way, a cycle of the program, the braking of `stopj`."""


@final
@dataclass(frozen=True, slots=True)
class WatchedData:
    """Samples at rest, packages left out and not newer, the controller's clock fitted to them."""

    samples: list[Sample]
    skipped: int
    stale: int
    rate_hz: float
    clock: DelayFit


class WatchedRobot(MovingRobot, Protocol):
    """The robot, as the steps use it."""

    async def watch_data(self, seconds: float) -> WatchedData:
        """All packages of so many seconds."""

    async def contact_seen(self, *, closed: bool, limit_s: float) -> bool:
        """Wait until the contact input is closed, or is not; whether it was within the limit, s."""


def steps_of(robot: WatchedRobot, clock: Clock, contact_input: int | None) -> tuple[CommissioningStep, ...]:
    """The steps of `robot`, those that move last. contact_input: of the probe's wire, None without one."""
    wire = CommissioningStep(
        "wire",
        f"the probe's wire, {_CONTACTS} times",
        f"Somebody closes the loop of the probe by hand, and input {contact_input} follows. Nothing moves.",
        "the controller stops at a contact by itself, whatever this computer does",
        partial(_wire, robot),
    )
    return (
        CommissioningStep(
            "data",
            f"{_DATA_S:g} s of packages",
            f"RTDE sends every cycle for {_DATA_S:g} s. Nothing moves.",
            "joints at a contact are known by the time of their package",
            partial(_data, robot),
        ),
        *([] if contact_input is None else [wire]),
        CommissioningStep(
            "tenth",
            "a tenth of a degree of each axis",
            f"Each axis moves by +{TENTH_DEG:g}° and back, A1 first, at {TENTH_DEG_S:g} deg/s.",
            "a search moves its own axes, in their direction, by their amount",
            lambda person: tenths(robot),
            moves=True,
        ),
        CommissioningStep(
            "stop",
            "the distance of a stop",
            f"A1 goes {STOPS} times towards +{LINE_DEG:g}° at {LINE_DEG_S:g} deg/s, is stopped on the way by this "
            "computer, and goes back.",
            "a touch presses the tip by no more than this distance",
            partial(_stops, robot, clock),
            moves=True,
        ),
    )


async def _data(robot: WatchedRobot, person: Person) -> list[Figure]:
    found = await robot.watch_data(_DATA_S)
    expected = _DATA_S * found.rate_hz
    most = int(expected * _MISSED_SHARE)
    delays_ms = [
        (sample.arrival_ns - found.clock.to_cell_ns(round(sample.time_s * 1e9))) * 1e-6 for sample in found.samples
    ]
    scatter_a = max(stdev(each) for each in zip(*(sample.currents for sample in found.samples), strict=True))
    return [
        Figure("packages", "packages", len(found.samples), least=0.99 * expected),
        Figure("skipped", "packages left out by the controller", found.skipped, most=most),
        Figure("stale", "packages not newer than the one before", found.stale, most=most),
        Figure("jitter_ms", "arrival after the fastest, median", median(delays_ms), "ms"),
        Figure("jitter_most_ms", "arrival after the fastest, latest", max(delays_ms), "ms"),
        Figure("drift_ppm", "drift of the controller's clock", found.clock.drift * 1e6, "ppm"),
        Figure("sigma_ms", "1 σ of a sample's time", found.clock.sigma_ns * 1e-6, "ms", most=_SIGMA_MS),
        Figure("current_a", "scatter of a current at rest, 1 σ, at most", scatter_a, "A", most=_CURRENT_SIGMA_A),
    ]


async def _wire(robot: WatchedRobot, person: Person) -> list[Figure]:
    for number in range(1, _CONTACTS + 1):
        text = f"Touch the tip with the wire, and let go ({number} of {_CONTACTS})"
        await person.told(text, robot.name, "touch")
        for closed in (True, False):
            if not await robot.contact_seen(closed=closed, limit_s=_WAIT_S):
                state = "closed" if closed else "open again"
                what = f"the contact input was not {state} within {_WAIT_S:g} s"
                raise DeviceFault(robot.name, what, "check the wire, `contact_input` and `contact_level`")
    return [Figure("contacts", "contacts seen at the input", _CONTACTS)]


async def _stops(robot: WatchedRobot, clock: Clock, person: Person) -> list[Figure]:
    return stop_figures(await stops(robot, clock), _LONGEST_STOP_S)
